"""Moves: drive a metre, turn a quarter, go there; the service that closes the loop on the pose."""
