"""What robots tell each other: the announcement, and the ledger of who announced what."""
