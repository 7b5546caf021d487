"""Files made from the code: schemas and golden samples of the messages, reference pages."""
