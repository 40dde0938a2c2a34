"""Running a matrix: tasks, executors, scores."""
