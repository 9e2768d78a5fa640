"""Dec-MCTS on the same utility."""
