"""What an export of a DIC program holds, found from the content of its files."""
