//! What the writers write, read back by hand: counts, coordinates, orientation, and that nothing else is left in the
//! folder.

use std::path::{Path, PathBuf};

use gic_continuum::Filling;
use gic_geometry::{MeshNotes, TriangleMesh, write_mesh_ply, write_msh, write_obj, write_stl};
use glam::DVec3;

/// An ellipsoid off the origin, so that no axis can be mistaken for another.
fn filling() -> Filling {
    let distance = |p: DVec3| {
        let p = p - DVec3::new(0.03, 0.05, 0.07);
        0.1 * ((p / DVec3::new(0.15, 0.11, 0.08)).length() - 1.0)
    };
    Filling::of_body((DVec3::splat(-0.2), DVec3::splat(0.3)), 0.02, 0.06, distance).unwrap()
}

/// A folder of this test's own, removed with it.
struct Folder(PathBuf);

impl Folder {
    fn new(test: &str) -> Folder {
        let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("exports-{test}-{}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Folder(path)
    }

    /// The only file in the folder.
    fn read(&self, name: &str) -> Vec<u8> {
        let names: Vec<_> = std::fs::read_dir(&self.0).unwrap().map(|e| e.unwrap().file_name()).collect();
        assert_eq!(names, [name], "the temporary file is gone");
        std::fs::read(self.0.join(name)).unwrap()
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn float(bytes: &[u8], at: usize) -> f64 {
    f64::from(f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()))
}

fn point(bytes: &[u8], at: usize) -> DVec3 {
    DVec3::new(float(bytes, at), float(bytes, at + 4), float(bytes, at + 8))
}

fn integer(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
}

/// Numbers of a line after its first `skip` words.
fn numbers(line: &str, skip: usize) -> Vec<f64> {
    line.split_whitespace().skip(skip).map(|w| w.parse().unwrap()).collect()
}

fn assert_same(read: &TriangleMesh, written: &TriangleMesh) {
    assert_eq!(read.triangles, written.triangles);
    assert_eq!(read.vertices.len(), written.vertices.len());
    for (a, b) in read.vertices.iter().zip(&written.vertices) {
        assert!((*a - *b).abs().max_element() < 1e-7, "{a} {b}");
    }
    assert!(read.is_watertight());
    assert!((read.volume() / written.volume() - 1.0).abs() < 1e-5);
}

#[test]
fn obj_is_read_back() {
    let mesh = filling().surface_mesh();
    let folder = Folder::new("obj");
    write_obj(&folder.0.join("a.obj"), &mesh, &MeshNotes::default()).unwrap();
    let text = String::from_utf8(folder.read("a.obj")).unwrap();
    let mut read = TriangleMesh::default();
    for line in text.lines() {
        match line.split(' ').next().unwrap() {
            "v" => read.vertices.push(DVec3::from_slice(&numbers(line, 1))),
            "vn" => read.normals.push(DVec3::from_slice(&numbers(line, 1))),
            "f" => {
                let corners: Vec<(u32, u32)> = line
                    .split(' ')
                    .skip(1)
                    .map(|w| w.split_once("//").unwrap())
                    .map(|(v, n)| (v.parse().unwrap(), n.parse().unwrap()))
                    .collect();
                assert!(corners.iter().all(|(v, n)| v == n), "a vertex and its normal have one number");
                read.triangles.push([0, 1, 2].map(|k| corners[k].0 - 1));
            }
            other => assert_eq!(other, "#"),
        }
    }
    assert_same(&read, &mesh);
    for (a, b) in read.normals.iter().zip(&mesh.normals) {
        assert!((*a - *b).length() < 2e-5);
    }
}

#[test]
fn stl_is_read_back() {
    let mesh = filling().surface_mesh();
    let folder = Folder::new("stl");
    write_stl(&folder.0.join("a.stl"), &mesh).unwrap();
    let bytes = folder.read("a.stl");
    assert_eq!(integer(&bytes, 80) as usize, mesh.triangles.len());
    assert_eq!(bytes.len(), 84 + 50 * mesh.triangles.len());
    assert!(!bytes.starts_with(b"solid"), "that would announce an ASCII file");
    for (t, triangle) in mesh.triangles.iter().enumerate() {
        let at = 84 + 50 * t;
        let corners = [1, 2, 3].map(|k| point(&bytes, at + 12 * k));
        for (read, &i) in corners.iter().zip(triangle) {
            assert!((*read - mesh.vertices[i as usize]).length() < 1e-7);
        }
        let [a, b, c] = triangle.map(|i| mesh.vertices[i as usize]);
        let facet = (b - a).cross(c - a).normalize();
        assert!((point(&bytes, at) - facet).length() < 1e-5, "the facet's normal points outward");
    }
}

/// The lines of the header of a PLY file, and where its body starts.
fn ply_header(bytes: &[u8]) -> (Vec<&str>, usize) {
    let end = b"end_header\n";
    let start = bytes.windows(end.len()).position(|w| w == end).unwrap() + end.len();
    (std::str::from_utf8(&bytes[..start]).unwrap().lines().collect(), start)
}

#[test]
fn mesh_ply_is_read_back() {
    let mesh = filling().surface_mesh();
    let folder = Folder::new("ply");
    write_mesh_ply(&folder.0.join("a.ply"), &mesh, &MeshNotes::default()).unwrap();
    let bytes = folder.read("a.ply");
    let (header, start) = ply_header(&bytes);
    assert_eq!(&header[..2], ["ply", "format binary_little_endian 1.0"]);
    assert!(header.contains(&format!("element vertex {}", mesh.vertices.len()).as_str()));
    assert!(header.contains(&format!("element face {}", mesh.triangles.len()).as_str()));
    let faces = start + 24 * mesh.vertices.len();
    assert_eq!(bytes.len(), faces + 13 * mesh.triangles.len());
    let read = TriangleMesh {
        vertices: (0..mesh.vertices.len()).map(|i| point(&bytes, start + 24 * i)).collect(),
        normals: (0..mesh.vertices.len()).map(|i| point(&bytes, start + 24 * i + 12)).collect(),
        triangles: (0..mesh.triangles.len())
            .map(|t| {
                assert_eq!(bytes[faces + 13 * t], 3);
                [1, 5, 9].map(|k| integer(&bytes, faces + 13 * t + k))
            })
            .collect(),
    };
    assert_same(&read, &mesh);
    assert!(read.normals.iter().zip(&mesh.normals).all(|(a, b)| (*a - *b).length() < 1e-6));
}

#[test]
fn colours_stand_at_the_vertices() {
    let mesh = filling().surface_mesh();
    let folder = Folder::new("colours");
    let colors: Vec<[f32; 3]> = (0..mesh.vertices.len()).map(|i| [(i % 2) as f32, 0.5, 0.2]).collect();
    let notes = MeshNotes { comment: "3 kg", colors: Some(&colors) };
    write_obj(&folder.0.join("a.obj"), &mesh, &notes).unwrap();
    let text = String::from_utf8(folder.read("a.obj")).unwrap();
    assert!(text.starts_with("# gic surface, metres 3 kg\n"));
    let rows: Vec<Vec<f64>> = text.lines().filter(|l| l.starts_with("v ")).map(|l| numbers(l, 1)).collect();
    assert_eq!(rows.len(), mesh.vertices.len());
    assert_eq!((&rows[0][3..], &rows[1][3..]), (&[0.0, 0.5, 0.2][..], &[1.0, 0.5, 0.2][..]));
    let folder = Folder::new("colours of a PLY");
    write_mesh_ply(&folder.0.join("a.ply"), &mesh, &notes).unwrap();
    let bytes = folder.read("a.ply");
    let (header, start) = ply_header(&bytes);
    assert!(header.contains(&"property uchar red") && header.contains(&"comment gic surface, metres 3 kg"));
    assert_eq!(&bytes[start + 27 + 24..start + 27 + 27], [255, 128, 51], "the second vertex");
}

#[test]
fn msh_is_read_back() {
    let mesh = filling().tetrahedra(0.04).unwrap();
    let folder = Folder::new("msh");
    write_msh(&folder.0.join("a.msh"), &mesh, "2 kg").unwrap();
    let text = String::from_utf8(folder.read("a.msh")).unwrap();
    let section = |name: &str| -> Vec<&str> {
        let lines = text.lines().skip_while(|l| *l != format!("${name}")).skip(1);
        lines.take_while(|l| *l != format!("$End{name}")).collect()
    };
    assert_eq!(section("MeshFormat"), ["2.2 0 8"]);
    assert_eq!(section("Comments"), ["gic body, metres 2 kg"]);
    let nodes = section("Nodes");
    assert_eq!(nodes[0].parse::<usize>().unwrap(), mesh.vertices.len());
    for (i, (line, vertex)) in nodes[1..].iter().zip(&mesh.vertices).enumerate() {
        assert_eq!(numbers(line, 0), [(i + 1) as f64, vertex.x, vertex.y, vertex.z]);
    }
    let elements = section("Elements");
    assert_eq!(elements[0].parse::<usize>().unwrap(), mesh.tetrahedra.len());
    assert_eq!(elements.len() - 1, mesh.tetrahedra.len());
    let mut volume = 0.0;
    for (i, (line, corners)) in elements[1..].iter().zip(&mesh.tetrahedra).enumerate() {
        let mut expected = vec![(i + 1) as f64, 4.0, 2.0, 1.0, 1.0];
        expected.extend(corners.map(|c| f64::from(c + 1)));
        assert_eq!(numbers(line, 0), expected);
        let [a, b, c, d] = corners.map(|c| mesh.vertices[c as usize]);
        volume += (b - a).cross(c - a).dot(d - a) / 6.0;
    }
    assert!((volume / filling().volume() - 1.0).abs() < 0.1, "{volume}");
}

#[test]
fn a_folder_that_is_missing_is_named() {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("no such folder").join("a.obj");
    let error = write_obj(&path, &TriangleMesh::default(), &MeshNotes::default()).unwrap_err();
    assert!(error.to_string().contains("no such folder"), "{error}");
}
