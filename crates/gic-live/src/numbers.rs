//! A world as a list of numbers, which crosses into the module's memory without a parser.

use gic_mpm::{Body, Collider, ColliderPath, Contact, Material, MaterialKind, Primitive, Stepping, World};
use glam::{DQuat, DVec3};

/// The numbers of a world of one body, for [`decode`]; `None` where it has another number of bodies.
pub fn encode(world: &World) -> Option<Vec<f64>> {
    let [body] = &world.bodies[..] else { return None };
    let kind = body.material.kind();
    let parameters = body.material.parameters();
    let mut numbers = vec![position_of(kind) as f64, parameters.len() as f64];
    numbers.extend(parameters);
    numbers.extend([body.density_kg_m3, body.particle_volume_m3, world.grid_spacing_m, world.frame_rate_hz]);
    for vector in [world.gravity_m_s2, body.velocity_m_s, body.angular_velocity_rad_s] {
        numbers.extend(vector.to_array());
    }
    numbers.push(world.colliders.len() as f64);
    world.colliders.iter().for_each(|collider| encode_collider(collider, &mut numbers));
    numbers.push(body.positions.len() as f64);
    for (p, position) in body.positions.iter().enumerate() {
        numbers.extend(position.to_array());
        numbers.push(body.volume_factors.get(p).copied().unwrap_or(1.0));
    }
    Some(numbers)
}

/// The world of some numbers; `None` where they are not what [`encode`] writes.
pub fn decode(numbers: &[f64]) -> Option<World> {
    let mut reader = Reader(numbers.iter());
    let kind = *MaterialKind::ALL.get(reader.count()?)?;
    let parameters = (0..reader.count()?).map(|_| reader.number()).collect::<Option<Vec<_>>>()?;
    let material = Material::assemble(kind, &parameters)?;
    let [density_kg_m3, particle_volume_m3, grid_spacing_m, frame_rate_hz] = reader.numbers()?;
    let [gravity_m_s2, velocity_m_s, angular_velocity_rad_s] = [reader.vector()?, reader.vector()?, reader.vector()?];
    let colliders = (0..reader.count()?).map(|_| decode_collider(&mut reader)).collect::<Option<_>>()?;
    let (mut positions, mut volume_factors) = (Vec::new(), Vec::new());
    for _ in 0..reader.count()? {
        positions.push(reader.vector()?);
        volume_factors.push(reader.number()?);
    }
    let body = Body {
        material,
        density_kg_m3,
        particle_volume_m3,
        volume_factors,
        positions,
        velocity_m_s,
        angular_velocity_rad_s,
        own_velocities_m_s: Vec::new(),
    };
    Some(World {
        bodies: vec![body],
        colliders,
        gravity_m_s2,
        grid_spacing_m,
        frame_rate_hz,
        stepping: Stepping::STABLE,
    })
}

fn position_of(kind: MaterialKind) -> usize {
    MaterialKind::ALL.iter().position(|&other| other == kind).unwrap_or(MaterialKind::ALL.len())
}

fn encode_collider(collider: &Collider, numbers: &mut Vec<f64>) {
    let (shape, size) = match collider.primitive {
        Primitive::HalfSpace { normal } => (0, normal),
        Primitive::Sphere { radius_m } => (1, DVec3::splat(radius_m)),
        Primitive::Box { half_size_m } => (2, half_size_m),
        Primitive::Pad { half_size_m } => (3, half_size_m),
        Primitive::Cylinder { radius_m, half_height_m } => (4, DVec3::new(radius_m, half_height_m, 0.0)),
        Primitive::Capsule { radius_m, half_height_m } => (5, DVec3::new(radius_m, half_height_m, 0.0)),
    };
    let (contact, friction) = match collider.contact {
        Contact::Sticky => (0, 0.0),
        Contact::Slip { friction } => (1, friction),
        Contact::Separating { friction } => (2, friction),
    };
    numbers.push(f64::from(shape));
    numbers.extend(size.to_array());
    numbers.extend([f64::from(contact), friction]);
    match &collider.path {
        ColliderPath::Uniform { position_m, world_from_collider, velocity_m_s, angular_velocity_rad_s } => {
            numbers.extend(world_from_collider.to_array());
            numbers.push(0.0);
            for vector in [position_m, velocity_m_s, angular_velocity_rad_s] {
                numbers.extend(vector.to_array());
            }
        }
        ColliderPath::Keyframed { keys, world_from_collider } => {
            numbers.extend(world_from_collider.to_array());
            numbers.push(keys.len() as f64);
            for (time_s, position) in keys {
                numbers.push(*time_s);
                numbers.extend(position.to_array());
            }
        }
    }
}

fn decode_collider(reader: &mut Reader) -> Option<Collider> {
    let shape = reader.count()?;
    let size = reader.vector()?;
    let primitive = match shape {
        0 => Primitive::HalfSpace { normal: size },
        1 => Primitive::Sphere { radius_m: size.x },
        2 => Primitive::Box { half_size_m: size },
        3 => Primitive::Pad { half_size_m: size },
        4 => Primitive::Cylinder { radius_m: size.x, half_height_m: size.y },
        5 => Primitive::Capsule { radius_m: size.x, half_height_m: size.y },
        _ => return None,
    };
    let (kind, friction) = (reader.count()?, reader.number()?);
    let contact = match kind {
        0 => Contact::Sticky,
        1 => Contact::Slip { friction },
        2 => Contact::Separating { friction },
        _ => return None,
    };
    let world_from_collider = DQuat::from_array(reader.numbers()?);
    let path = match reader.count()? {
        0 => ColliderPath::Uniform {
            position_m: reader.vector()?,
            world_from_collider,
            velocity_m_s: reader.vector()?,
            angular_velocity_rad_s: reader.vector()?,
        },
        count => {
            let keys = (0..count).map(|_| Some((reader.number()?, reader.vector()?))).collect::<Option<_>>()?;
            ColliderPath::Keyframed { keys, world_from_collider }
        }
    };
    Some(Collider { primitive, path, contact })
}

/// Numbers in their order.
struct Reader<'a>(core::slice::Iter<'a, f64>);

impl Reader<'_> {
    fn number(&mut self) -> Option<f64> {
        self.0.next().copied()
    }

    fn numbers<const COUNT: usize>(&mut self) -> Option<[f64; COUNT]> {
        let mut numbers = [0.0; COUNT];
        for number in &mut numbers {
            *number = self.number()?;
        }
        Some(numbers)
    }

    fn vector(&mut self) -> Option<DVec3> {
        self.numbers().map(DVec3::from_array)
    }

    /// A number that counts something.
    fn count(&mut self) -> Option<usize> {
        self.number().filter(|number| *number >= 0.0).map(|number| number as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::live_simulation::tests::falling_block;

    #[test]
    fn a_world_comes_back() {
        let mut world = falling_block();
        world.colliders.push(Collider {
            primitive: Primitive::Box { half_size_m: DVec3::new(0.1, 0.2, 0.3) },
            path: ColliderPath::Keyframed {
                keys: vec![(0.0, DVec3::X), (1.0, DVec3::Y)],
                world_from_collider: DQuat::from_rotation_x(0.3),
            },
            contact: Contact::Separating { friction: 0.4 },
        });
        let numbers = encode(&world).unwrap();
        let decoded = decode(&numbers).unwrap();
        assert_eq!(format!("{world:?}"), format!("{decoded:?}"));
        assert!(decode(&numbers[..numbers.len() - 1]).is_none());
    }
}
