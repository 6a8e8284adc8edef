"""Pictures without a window: cameras, off-screen drawing, contact sheets."""
