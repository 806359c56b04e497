"""What a person looks at: preview, turntable, page."""
