//! x
use gic_calibrate::grey::Grey;
fn main(){
 let mut all = vec![];
 for c in 0..4 {
  let g: Vec<Grey> = (-1..10).map(|f| { let i=image::open(format!("/work/shared/data/film_ball/as_filmed/data/r_{c}_{f}.png")).unwrap().into_rgb8();
   Grey{width:i.width() as usize,height:i.height() as usize,values:i.pixels().map(|p| (p[0] as f32+p[1] as f32+p[2] as f32)/3.0).collect()}}).collect();
  all.push(Grey::still(&g).unwrap());
 }
 let t=std::time::Instant::now();
 gic_calibrate::probe(&all, 0.0289);
 println!("{:?}", t.elapsed());
}
