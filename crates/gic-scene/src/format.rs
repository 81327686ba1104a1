//! The formats that are read.

/// The on-disk format a scene was read from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// `all_data.json`: fixed, synchronised cameras.
    PacNerf,
    /// `transforms_train.json` and its siblings: nerf_synthetic (static) and D-NeRF (one moving camera, with `time`).
    Blender,
    /// `camera.json` and `frame.json`: fixed, synchronised cameras, pictures with alpha.
    SpringGausSynthetic,
    /// `dynamic/cameras_calib.json`: a few video cameras, and photographs of the object at rest.
    SpringGausReal,
    /// `transforms.json`: nerfstudio, with lens distortion.
    Nerfstudio,
    /// A COLMAP sparse model, binary or text.
    Colmap,
}

impl std::fmt::Display for Format {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Format::PacNerf => "PAC-NeRF",
            Format::Blender => "Blender / D-NeRF",
            Format::SpringGausSynthetic => "Spring-Gaus, synthetic",
            Format::SpringGausReal => "Spring-Gaus, real capture",
            Format::Nerfstudio => "nerfstudio",
            Format::Colmap => "COLMAP",
        })
    }
}
