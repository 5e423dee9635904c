"""Boards that speak something else: adapters that turn a vendor's framing into the bench's samples."""
