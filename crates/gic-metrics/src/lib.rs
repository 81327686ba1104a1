//! Metrics of the field: chamfer distance, earth mover's distance, PSNR and SSIM.
