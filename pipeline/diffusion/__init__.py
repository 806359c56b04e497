"""The diffusion model: bundle files, sessions, tokenizer, prompts, noise schedule, score distillation."""
