"""What `make schemas` writes: schemas and golden samples of the messages, two reference pages."""
