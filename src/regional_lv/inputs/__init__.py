"""What the simulator depends on, and what a study does with each number: inputs with roles."""
