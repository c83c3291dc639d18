"""What makes the filter accurate and robust: the fast search, lines, outliers, covariance, tilt, and health."""
