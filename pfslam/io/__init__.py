"""Reading and writing: the course's files, CARMEN logs, trajectories, maps, images."""
