"""Plan, move, observe, estimate, plan again until every goal is reached: active SLAM by a team."""
