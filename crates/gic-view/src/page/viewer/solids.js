// Triangles of the obstacles' shapes in their own frames: places and normals, three numbers each.
function solidOf(obstacle) {
  const [a, b, c] = obstacle.half_size_m, triangles = [];
  const corner = (place, normal) => triangles.push(...place, ...normal);
  // A surface of revolution about y from a profile of (radius, height, outward radial, outward along y).
  const turnedProfile = (profile) => {
    const steps = 48;
    const point = ([r, y, nr, ny], k) => {
      const angle = (2 * Math.PI * k) / steps, u = Math.cos(angle), v = Math.sin(angle);
      return [[r * u, y, r * v], [nr * u, ny, nr * v]];
    };
    for (let i = 0; i + 1 < profile.length; i++) {
      for (let k = 0; k < steps; k++) {
        const [p, q, r, s] = [point(profile[i], k), point(profile[i], k + 1), point(profile[i + 1], k), point(profile[i + 1], k + 1)];
        for (const [place, normal] of [p, q, r, q, s, r]) corner(place, normal);
      }
    }
  };
  const arc = (from, to, radius, height) => {
    const profile = [];
    for (let k = 0; k <= 12; k++) {
      const angle = from + ((to - from) * k) / 12, [r, y] = [Math.cos(angle), Math.sin(angle)];
      profile.push([radius * r, height + radius * y, r, y]);
    }
    return profile;
  };
  const quarter = Math.PI / 2;
  if (obstacle.shape === "sphere") turnedProfile(arc(-quarter, quarter, a, 0));
  if (obstacle.shape === "capsule") turnedProfile([...arc(-quarter, 0, a, -b), ...arc(0, quarter, a, b)]);
  if (obstacle.shape === "cylinder") {
    turnedProfile([[0, -b, 0, -1], [a, -b, 0, -1]]);
    turnedProfile([[a, -b, 1, 0], [a, b, 1, 0]]);
    turnedProfile([[a, b, 0, 1], [0, b, 0, 1]]);
  }
  if (obstacle.shape === "box") {
    for (let axis = 0; axis < 3; axis++) {
      for (const side of [-1, 1]) {
        const at = (u, v) => {
          const p = [0, 0, 0];
          p[axis] = side; p[(axis + 1) % 3] = u; p[(axis + 2) % 3] = v;
          return [p[0] * a, p[1] * b, p[2] * c];
        };
        const normal = [0, 0, 0];
        normal[axis] = side;
        for (const [u, v] of [[-1, -1], [1, -1], [-1, 1], [1, -1], [1, 1], [-1, 1]]) corner(at(u, v), normal);
      }
    }
  }
  return new Float32Array(triangles);
}
