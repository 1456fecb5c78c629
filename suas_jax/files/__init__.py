"""Files: bounded reading, atomic writing, and a folder that keeps what can be made again."""
