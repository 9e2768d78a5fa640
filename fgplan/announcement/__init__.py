"""What robots tell each other: the announcement on the wire, and the ledger of who announced what."""
