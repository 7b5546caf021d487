"""What a person sends who reports a problem."""
