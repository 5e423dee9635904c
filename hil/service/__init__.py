"""The bench as a service: an HTTP interface, live telemetry, a page.  It calls the library and holds no bench logic."""
