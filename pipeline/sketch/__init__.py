"""A coarse mesh or a drawing as the solid that guides a shape."""
