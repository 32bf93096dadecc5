"""The paper's matcher: graph cuts with occlusions after Kolmogorov and Zabih (2002)."""
