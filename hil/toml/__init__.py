"""Files in TOML: read strictly, with the key that was meant where one is misspelt, and written."""
