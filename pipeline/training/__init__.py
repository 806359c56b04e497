"""What every training by score distillation shares. No model and no scene of its own."""
