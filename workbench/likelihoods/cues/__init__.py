"""Image cues of particles: appearance, background, silhouette, edges."""
