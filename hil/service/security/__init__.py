"""Who may ask the service for what: addresses, hosts and origins, tokens with roles, headers, the audit log."""
