"""Pictures onto the surface: balanced colours, the best view of each place, maps from above, textured meshes."""
