"""Text to textured mesh on the CPU: Latent-NeRF (Metzer et al. 2023), in files, over ONNX models."""
