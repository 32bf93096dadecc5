"""Many depth maps become one surface: a signed distance in blocks of voxels, and marching cubes on it."""
