//! Reading and checking `twin.json`.

use std::collections::BTreeMap;
use std::path::Path;

use gic_files::FileError;
use gic_mpm::{Material, MaterialError, MaterialKind};
use serde_json::Value;

use super::json_object::{JsonObject, nearest};
use super::{ContactKind, Keyframe, MatterSource, Obstacle, ObstacleShape, SCHEMA, Setting, Twin};
use crate::error::{Result, TwinError};
use crate::matter::{Solid, SolidKind};

pub(super) const TOP_KEYS: &[&str] = &[
    "schema",
    "material",
    "intervals_95",
    "identifiable",
    "initial_velocity_m_s",
    "initial_angular_velocity_rad_s",
    "density_kg_m3",
    "gravity_m_s2",
    "colliders",
    "grid_spacing_m",
    "particle_spacing_m",
    "frame_rate_hz",
    "frames",
    "substeps_per_frame",
    "continuum",
    "loss",
    "seed",
    "gic_version",
    "seconds",
];

pub(super) fn twin(path: &Path, settings: &[Setting]) -> Result<Twin> {
    let mut value = json(path)?;
    for setting in settings {
        setting.apply(path, &mut value)?;
    }
    from_value(path, &value)
}

fn json(path: &Path) -> Result<Value> {
    let text = gic_files::input::read_to_string(path).map_err(TwinError::read(path))?;
    Ok(serde_json::from_str(&text).map_err(FileError::syntax(path, "JSON"))?)
}

fn toml(path: &Path) -> Result<Value> {
    let text = gic_files::input::read_to_string(path).map_err(TwinError::read(path))?;
    Ok(toml::from_str(&text).map_err(FileError::syntax(path, "TOML"))?)
}

pub(super) fn from_value(file: &Path, value: &Value) -> Result<Twin> {
    let top = JsonObject::new(file, "", value)?;
    top.allow_only(TOP_KEYS)?;
    let schema = top.string("schema", "add \"schema\": \"gic.twin/1\"")?;
    if schema != SCHEMA {
        return Err(top.problem("schema", format!("is \"{schema}\"; this gic reads \"{SCHEMA}\""), None));
    }
    let material = material(&top.object("material", "add for example {\"model\": \"elastic\", ...}")?)?;
    let continuum = continuum(file, &top)?;
    let defaults = Twin::new(material, continuum);
    Ok(Twin {
        intervals_95: intervals(file, &top)?,
        identifiable: verdicts(&top)?,
        initial_velocity_m_s: top.vector("initial_velocity_m_s")?.unwrap_or(defaults.initial_velocity_m_s),
        initial_angular_velocity_rad_s: top
            .vector("initial_angular_velocity_rad_s")?
            .unwrap_or(defaults.initial_angular_velocity_rad_s),
        density_kg_m3: top.positive("density_kg_m3")?.unwrap_or(defaults.density_kg_m3),
        gravity_m_s2: top.vector("gravity_m_s2")?.unwrap_or(defaults.gravity_m_s2),
        colliders: obstacles(file, &top)?,
        grid_spacing_m: top.positive("grid_spacing_m")?,
        particle_spacing_m: top.positive("particle_spacing_m")?,
        frame_rate_hz: top.positive("frame_rate_hz")?.unwrap_or(defaults.frame_rate_hz),
        frames: top.count("frames")?.unwrap_or(defaults.frames),
        substeps_per_frame: top.count("substeps_per_frame")?,
        loss: top.non_negative("loss")?,
        seed: match top.get("seed") {
            None => 0,
            Some(v) => v.as_u64().ok_or_else(|| top.problem("seed", "must be a whole number of at least 0", None))?,
        },
        gic_version: top.get("gic_version").map(|_| top.string("gic_version", "")).transpose()?.map(str::to_owned),
        seconds: named(file, &top, "seconds", |o, key| o.non_negative(key).map(Option::unwrap_or_default))?,
        ..defaults
    })
}

/// The law of that name.
fn kind_named(name: &str) -> Option<MaterialKind> {
    MaterialKind::ALL.into_iter().find(|kind| kind.name() == name)
}

/// The parameters of a law, by the law's name; `None` for a name that is no law's.
pub(super) fn parameter_names(model: &str) -> Option<&'static [&'static str]> {
    kind_named(model).map(MaterialKind::parameter_names)
}

fn material(m: &JsonObject) -> Result<Material> {
    let names = MaterialKind::ALL.map(MaterialKind::name);
    let model = m.string("model", &format!("one of {}", names.join(", ")))?;
    let Some(kind) = kind_named(model) else {
        return Err(unknown_choice(m, "model", model, &names));
    };
    let keys = kind.parameter_names();
    m.allow_only(&[&["model"], keys].concat())?;
    let mut values = Vec::new();
    for (i, key) in keys.iter().enumerate() {
        let presumed = (i + kind.presumed().len()).checked_sub(keys.len()).map(|late| kind.presumed()[late]);
        let missing = || m.problem(key, "is missing", Some(&format!("{model} needs {}", keys.join(", "))));
        values.push(m.number(key)?.or(presumed).ok_or_else(missing)?);
    }
    Material::new(kind, &values).map_err(|error| match error {
        MaterialError::OutOfRange { name, value, must_be, .. } => {
            let incompressible = "0.5 means incompressible, which needs an infinite bulk modulus; use at most 0.49";
            let hint = if name == "poisson_ratio" { incompressible } else { "units are SI, angles in degrees" };
            m.problem(name, format!("is {value}; it must be {must_be}"), Some(hint))
        }
        other => m.problem("model", other.to_string(), None),
    })
}

fn continuum(file: &Path, top: &JsonObject) -> Result<MatterSource> {
    let key = "continuum";
    let hint = "give a file (.ply particles; .obj, .ply or .stl mesh) or a shape such as \
                {\"shape\": \"box\", \"size_m\": [0.2, 0.2, 0.2]}";
    match top.require(key, hint)? {
        Value::String(name) if !name.is_empty() => {
            let folder = file.parent().unwrap_or(Path::new(""));
            Ok(MatterSource::File(folder.join(name)))
        }
        value @ Value::Object(_) => Ok(MatterSource::Solid(shape(&JsonObject::new(file, key, value)?)?)),
        _ => Err(top.problem(key, "must be the name of a file or a shape", Some(hint))),
    }
}

fn shape(s: &JsonObject) -> Result<Solid> {
    const NAMES: &[&str] = &["cross", "box", "sphere", "torus", "cylinder"];
    let name = s.string("shape", "one of cross, box, sphere, torus, cylinder")?;
    let own: &[&str] = match name {
        "cross" => &["size_m", "thickness_m"],
        "box" => &["size_m"],
        "sphere" => &["radius_m"],
        "torus" => &["major_radius_m", "minor_radius_m"],
        "cylinder" => &["radius_m", "height_m"],
        other => return Err(unknown_choice(s, "shape", other, NAMES)),
    };
    s.allow_only(&[&["shape", "centre_m", "rotation_deg"], own].concat())?;
    let length = |key: &str| s.required_positive(key, "in metres");
    let kind = match name {
        "cross" => {
            let size_m = s.size("size_m", "lengths of the three bars, in metres")?;
            let thickness_m = length("thickness_m")?;
            if size_m.iter().any(|&side| side < thickness_m) {
                let hint =
                    "`size_m` holds the whole lengths of the three bars, `thickness_m` the side of their section";
                return Err(s.problem("thickness_m", "must not exceed any of `size_m`", Some(hint)));
            }
            SolidKind::Cross { size_m, thickness_m }
        }
        "box" => SolidKind::Box { size_m: s.size("size_m", "three sides, in metres")? },
        "sphere" => SolidKind::Sphere { radius_m: length("radius_m")? },
        "torus" => {
            let (major_radius_m, minor_radius_m) = (length("major_radius_m")?, length("minor_radius_m")?);
            if minor_radius_m >= major_radius_m {
                let hint = "the major radius goes from the centre of the ring to the centre of its tube";
                return Err(s.problem("minor_radius_m", "must be smaller than `major_radius_m`", Some(hint)));
            }
            SolidKind::Torus { major_radius_m, minor_radius_m }
        }
        _ => SolidKind::Cylinder { radius_m: length("radius_m")?, height_m: length("height_m")? },
    };
    Ok(Solid {
        kind,
        centre_m: s.vector("centre_m")?.unwrap_or_default(),
        rotation_deg: s.vector("rotation_deg")?.unwrap_or_default(),
    })
}

/// The obstacles of a file: a JSON list, or JSON or TOML with a list `colliders`.
pub(super) fn obstacle_list(path: &Path) -> Result<Vec<Obstacle>> {
    let content = if path.extension().is_some_and(|ending| ending == "toml") { toml(path)? } else { json(path)? };
    obstacles_of(path, &content)
}

/// Obstacles of a list, or of an object with a list `colliders`.
pub(super) fn obstacles_of(origin: &Path, content: &Value) -> Result<Vec<Obstacle>> {
    let whole = if content.is_array() { serde_json::json!({ "colliders": content }) } else { content.clone() };
    let top = JsonObject::new(origin, "", &whole)?;
    top.allow_only(&["colliders"])?;
    obstacles(origin, &top)
}

/// The material in an object of its own.
pub(super) fn material_of(origin: &Path, content: &Value) -> Result<Material> {
    material(&JsonObject::new(origin, "material", content)?)
}

fn obstacles(file: &Path, top: &JsonObject) -> Result<Vec<Obstacle>> {
    let items = top.array("colliders")?.iter().enumerate();
    items.map(|(i, value)| obstacle(file, &JsonObject::new(file, &format!("colliders[{i}]"), value)?)).collect()
}

fn obstacle(file: &Path, o: &JsonObject) -> Result<Obstacle> {
    const NAMES: &[&str] = &["half_space", "sphere", "box", "cylinder", "capsule"];
    let name = o.string("shape", "one of half_space, sphere, box, cylinder, capsule")?;
    let own: &[&str] = match name {
        "half_space" => &["point_m", "normal"],
        "sphere" => &["centre_m", "radius_m"],
        "box" => &["centre_m", "size_m"],
        "cylinder" | "capsule" => &["centre_m", "radius_m", "height_m"],
        other => return Err(unknown_choice(o, "shape", other, NAMES)),
    };
    let common: &[&str] =
        &["shape", "contact", "friction", "rotation_deg", "velocity_m_s", "angular_velocity_rad_s", "keyframes"];
    o.allow_only(&[common, own].concat())?;
    let obstacle = Obstacle {
        shape: obstacle_shape(o, name)?,
        contact: contact(o)?,
        friction: o.non_negative("friction")?,
        rotation_deg: o.vector("rotation_deg")?,
        velocity_m_s: o.vector("velocity_m_s")?,
        angular_velocity_rad_s: o.vector("angular_velocity_rad_s")?,
        keyframes: keyframes(file, o)?,
    };
    if obstacle.contact == ContactKind::Sticky && obstacle.friction.is_some() {
        return Err(o.problem("friction", "has no meaning with sticky contact", Some("use slip or separating")));
    }
    let also_moving = obstacle.velocity_m_s.is_some() || obstacle.angular_velocity_rad_s.is_some();
    if !obstacle.keyframes.is_empty() && also_moving {
        return Err(o.problem(
            "keyframes",
            "contradict `velocity_m_s` and `angular_velocity_rad_s`",
            Some("give one of them"),
        ));
    }
    Ok(obstacle)
}

fn obstacle_shape(o: &JsonObject, name: &str) -> Result<ObstacleShape> {
    let length = |key: &str| o.required_positive(key, "in metres");
    let vector = |key: &str, hint: &str| {
        o.require(key, hint)?;
        Ok::<_, TwinError>(o.vector(key)?.unwrap_or_default())
    };
    if name == "half_space" {
        let normal = vector("normal", "for a floor in a world with y up: [0, 1, 0]")?;
        // Positively phrased: a normal of zeros or of huge numbers whose square overflows is refused as well.
        let squared: f64 = normal.iter().map(|x| x * x).sum();
        return if squared > 1e-24 && squared < 1e24 {
            Ok(ObstacleShape::HalfSpace { point_m: o.vector("point_m")?.unwrap_or_default(), normal })
        } else {
            Err(o.problem("normal", "has no direction", Some("for a floor in a world with y up: [0, 1, 0]")))
        };
    }
    let centre_m = vector("centre_m", "in metres")?;
    Ok(match name {
        "sphere" => ObstacleShape::Sphere { centre_m, radius_m: length("radius_m")? },
        "box" => ObstacleShape::Box { centre_m, size_m: o.size("size_m", "three sides, in metres")? },
        "cylinder" => {
            ObstacleShape::Cylinder { centre_m, radius_m: length("radius_m")?, height_m: length("height_m")? }
        }
        _ => ObstacleShape::Capsule { centre_m, radius_m: length("radius_m")?, height_m: length("height_m")? },
    })
}

fn contact(o: &JsonObject) -> Result<ContactKind> {
    match o.string("contact", "one of sticky, slip, separating")? {
        "sticky" => Ok(ContactKind::Sticky),
        "slip" => Ok(ContactKind::Slip),
        "separating" => Ok(ContactKind::Separating),
        other => Err(unknown_choice(o, "contact", other, &["sticky", "slip", "separating"])),
    }
}

fn keyframes(file: &Path, o: &JsonObject) -> Result<Vec<Keyframe>> {
    let mut keys: Vec<Keyframe> = Vec::new();
    for (i, value) in o.array("keyframes")?.iter().enumerate() {
        let key = JsonObject::new(file, &format!("{}[{i}]", o.field("keyframes")), value)?;
        key.allow_only(&["time_s", "position_m"])?;
        let missing = |field: &str| key.problem(field, "is missing", Some("a keyframe needs time_s and position_m"));
        let time_s = key.number("time_s")?.ok_or_else(|| missing("time_s"))?;
        let position_m = key.vector("position_m")?.ok_or_else(|| missing("position_m"))?;
        if keys.last().is_some_and(|last| last.time_s >= time_s) {
            return Err(key.problem("time_s", "must be later than that of the keyframe before", None));
        }
        keys.push(Keyframe { time_s, position_m });
    }
    Ok(keys)
}

fn intervals(file: &Path, top: &JsonObject) -> Result<BTreeMap<String, [f64; 2]>> {
    named(file, top, "intervals_95", |o, key| {
        let ends = o.array(key)?;
        match (ends.len(), ends.first().and_then(Value::as_f64), ends.get(1).and_then(Value::as_f64)) {
            (2, Some(low), Some(high)) if low <= high => Ok([low, high]),
            _ => Err(o.problem(key, "must be [low, high] with low <= high", None)),
        }
    })
}

fn verdicts(top: &JsonObject) -> Result<BTreeMap<String, bool>> {
    let Some(value) = top.get("identifiable") else { return Ok(BTreeMap::new()) };
    let wrong = || top.problem("identifiable", "must map parameters to true or false", None);
    let map = value.as_object().ok_or_else(wrong)?;
    map.iter().map(|(key, v)| Ok((key.clone(), v.as_bool().ok_or_else(wrong)?))).collect()
}

fn named<T>(
    file: &Path,
    top: &JsonObject,
    key: &str,
    read: impl Fn(&JsonObject, &str) -> Result<T>,
) -> Result<BTreeMap<String, T>> {
    let Some(value) = top.get(key) else { return Ok(BTreeMap::new()) };
    let object = JsonObject::new(file, key, value)?;
    object.entries().map(|(name, _)| Ok((name.clone(), read(&object, name)?))).collect()
}

fn unknown_choice(o: &JsonObject, key: &str, found: &str, valid: &[&str]) -> TwinError {
    let mean = nearest(found, valid).map(|n| format!("did you mean \"{n}\"? ")).unwrap_or_default();
    o.problem(key, format!("is \"{found}\", which is not known"), Some(&format!("{mean}One of {}", valid.join(", "))))
}
