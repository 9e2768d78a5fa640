"""Plan, move, observe, estimate, plan again: active multi-robot SLAM until all goals are reached."""
