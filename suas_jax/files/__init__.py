"""Files: bounded reading, atomic writing by one owner, a folder of what can be made again."""
