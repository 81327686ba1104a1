//! From Gaussians to matter (paper section 4.2): coarse-to-fine filling, surfaces, meshes, the Gaussian-informed continuum.
