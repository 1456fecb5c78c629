"""Material laws, one file each."""
