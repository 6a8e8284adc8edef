"""The timeline: keys of handles and sliders, the clip that is fitted to them, and its playback."""
