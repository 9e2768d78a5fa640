"""The incremental evaluator: exact re-evaluation of candidate paths from compressed messages."""
