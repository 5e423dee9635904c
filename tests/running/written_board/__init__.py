"""A board in C written from the pages alone, and a hundred and forty ways for it to misbehave."""
