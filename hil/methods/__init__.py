"""Several methods on one record: the observers of TW I384198 B1 with each gain, what it calls prior art, the bound."""
