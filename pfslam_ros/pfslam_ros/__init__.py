"""SLAM and localization for ROS 2: ``core`` is the logic and knows no ROS, ``node`` connects it."""
