"""The default bundle: a small latent diffusion model of everyday objects, from renders to ONNX.

In order: `catalogue`, `nouns`, `procedural` (the objects), `render`, `captions`, `dataset` (the pictures),
`autoencoder`, `denoiser`, `text_encoder` (the networks), `train_autoencoder`, `train_denoiser`,
`export_bundle`, `sample`.
"""
