"""pfslam: particle-filter SLAM and floor texture mapping, small enough to read."""
