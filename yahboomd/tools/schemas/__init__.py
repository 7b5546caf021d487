"""What messages, events and the configuration mean, in words and as schemas."""
