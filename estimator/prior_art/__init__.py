"""What TW I384198 B1 calls prior art, each method by itself and from its own source.

A method takes a record in SI and gives back a `Reading`: an angle, and the rate and parameters where it has them.  None
of them shares arithmetic with the observer; they share what the data sheet declares (`estimator.settings.Device`).
"""
