//! Cameras from pictures of printed boards.
pub mod detect;
pub mod grey;
mod align;
mod board;
mod bundle;
mod error;
mod homography;
mod lens;
mod rig;
mod start;
mod tuning;
pub use board::{Black, Board, TagPlace};
pub use error::{CalibrateError, Result};
pub use lens::Lens;
/// x
pub fn probe(pictures: &[grey::Grey], side: f64) {
    let sizes: Vec<[usize;2]> = pictures.iter().map(|p| [p.width, p.height]).collect();
    let names: Vec<String> = (0..pictures.len()).map(|n| format!("c{n}")).collect();
    let mut views: Vec<rig::View> = pictures.iter().enumerate().map(|(camera, p)| {
        let found = detect::find_tags(p);
        let n = found.len();
        let a: Vec<_> = found.into_iter().filter_map(|t| { let r = align::align(p, &t); if r.is_none() { println!("cam {camera} lost {t:?}"); } r }).collect();
        println!("{camera}: {n} found, {} aligned", a.len());
        rig::View { camera, moment: 0, tags: a }
    }).collect();
    let known = start::Known { names: &names, sizes: &sizes, lenses: None, board: std::env::args().nth(1).unwrap().parse().unwrap(), side_m: side, moments: 1, reference: 0 };
    let rig = start::start(&mut views, &known).unwrap();
    println!("start f {:?}", rig.lenses.iter().map(|l| l.focal_px()).collect::<Vec<_>>());
    let freedom = bundle::Freedom { lenses: true, reference: 0 };
    let mut rig = rig;
    for round in 0..12 {
        let mut b = bundle::Bundle::new(rig, &views, &sizes, freedom);
        b.adjust();
        let kept = b.corners.iter().filter(|c| c.is_kept).count();
        print!(""); println!("round {round}: noise {:.3} corners {} kept {}", b.noise_px, b.corners.len(), kept);
        for c in 0..pictures.len() { 
            let own: Vec<f64> = (0..b.corners.len()).filter(|&n| b.corners[n].is_kept && views[b.corners[n].view].camera==c).map(|n| b.residual(n).norm_squared()).collect();
            println!("  cam {c} tags {} rms {:.3} f {:?} pp {:?} d {:?} centre {:?}", views[c].tags.len(), (own.iter().sum::<f64>()/own.len() as f64).sqrt(), b.rig.lenses[c].focal_px(), b.rig.lenses[c].principal_px(), b.rig.lenses[c].distortion(), b.rig.world_from_camera[c].translation.vector.as_slice()); }
        {
            use nalgebra::{Vector3, Matrix3};
            let truth = [[-0.39292439654665673, 0.38871322000816066, -0.07346075555762574],[-0.3304519038041843, 0.3878445574753076, 0.2600554353546378],[0.29543102571594415, 0.5133353869526628, 0.28709158202514296],[0.3485441730269966, 0.47348848018891276, -0.13954040838431012]].map(Vector3::from);
            let ft = [382.896, 238.137, 378.689, 238.137];
            let own: Vec<Vector3<f64>> = b.rig.world_from_camera.iter().map(|p| p.translation.vector).collect();
            let (mt, mo) = (truth.iter().sum::<Vector3<f64>>() / 4.0, own.iter().sum::<Vector3<f64>>() / 4.0);
            let h: Matrix3<f64> = (0..4).map(|k| (truth[k] - mt) * (own[k] - mo).transpose()).sum();
            let svd = h.svd(true, true); let (u, v) = (svd.u.unwrap(), svd.v_t.unwrap());
            let r = u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, (u * v).determinant())) * v;
            let scale = (0..4).map(|k| (truth[k]-mt).norm()).sum::<f64>() / (0..4).map(|k| (own[k]-mo).norm()).sum::<f64>();
            println!("  ERR mm {:?} scale {scale:.4} f% {:?} fy% {:?}", (0..4).map(|k| ((r * (own[k] - mo) + mt - truth[k]).norm() * 1e4).round()/10.0).collect::<Vec<_>>(), (0..4).map(|k| ((b.rig.lenses[k].focal_px()[0] / ft[k] - 1.0) * 1e4).round()/100.0).collect::<Vec<_>>(), (0..4).map(|k| ((b.rig.lenses[k].focal_px()[1] / ft[k]/1.0133 - 1.0) * 1e4).round()/100.0).collect::<Vec<_>>());
        }
        rig = b.rig;
        let mut added = 0; let mut lost = 0;
        for v in 0..views.len() {
            for t in 0..rig.tags.len() {
                let id = rig.tags[t].1.id;
                if views[v].tags.iter().any(|s| s.id == id) { continue; }
                let Some(c) = rig.predict(views[v].camera, 0, t) else { continue };
                if let Some(a) = align::align(&pictures[v], &detect::Sighting { id, corners: c, border: 1 }) { views[v].tags.push(a); added += 1; } else { lost += 1; }
            }
        }
        println!("added {added} lost {lost}"); if added==0 { break; }
    }
}
