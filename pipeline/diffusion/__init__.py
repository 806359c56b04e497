"""The diffusion model as plain callables: bundle files, sessions, tokenizer, noise schedule, score distillation."""
