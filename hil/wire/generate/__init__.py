"""Everything that is generated from the spec of the wire: C header and source, DBC, pages, golden vectors."""
