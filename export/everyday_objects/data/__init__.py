"""What the default model is trained on: objects of our own, their colours and materials, pictures and
captions.
"""
