"""How models are made: exports of checkpoints, and the bundled model's data, networks and training."""
