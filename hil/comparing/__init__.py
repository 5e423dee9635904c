"""`hil compare` and `hil diff`: every observer and the prior art on one record; two runs or traces side by side."""
