"""Multi-robot SLAM with known association: measurements in, a joint belief out."""
