"""Results of other software as components: trajectories and depth maps in files."""
