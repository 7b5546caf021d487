"""Files made of the code: schemas and golden samples of the messages, pages of reference."""
