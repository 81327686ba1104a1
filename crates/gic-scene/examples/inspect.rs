//! Reports on a scene and saves its contact sheet: `cargo run --example inspect -- SCENE [SHEET.png]`.

use std::path::Path;

fn main() {
    let mut arguments = std::env::args().skip(1);
    let path = arguments.next().expect("a scene");
    let result = gic_scene::Scene::open(path).and_then(|scene| gic_scene::inspect(&scene)).and_then(|report| {
        print!("{report}");
        arguments.next().map_or(Ok(()), |sheet| report.contact_sheet.save_png(Path::new(&sheet)))
    });
    if let Err(error) = result {
        eprintln!("{error}");
        std::process::exit(1);
    }
}
