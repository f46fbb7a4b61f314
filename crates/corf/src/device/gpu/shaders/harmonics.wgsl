// Real spherical harmonics to degree 3 of a unit direction, in the order and with the signs of the splatting literature.
const H0 = 0.2820948;
const H1 = 0.4886025;
const H20 = 1.0925484;
const H21 = -1.0925484;
const H22 = 0.31539157;
const H23 = -1.0925484;
const H24 = 0.5462742;
const H30 = -0.5900436;
const H31 = 2.8906114;
const H32 = -0.4570458;
const H33 = 0.37317634;
const H34 = -0.4570458;
const H35 = 1.4453057;
const H36 = -0.5900436;

fn basis_of(d: vec3<f32>) -> array<f32, 16> {
    var y: array<f32, 16>;
    y[0] = H0;
    if (DEGREE >= 1u) {
        y[1] = -H1 * d.y;
        y[2] = H1 * d.z;
        y[3] = -H1 * d.x;
    }
    let xx = d.x * d.x;
    let yy = d.y * d.y;
    let zz = d.z * d.z;
    if (DEGREE >= 2u) {
        y[4] = H20 * d.x * d.y;
        y[5] = H21 * d.y * d.z;
        y[6] = H22 * (2.0 * zz - xx - yy);
        y[7] = H23 * d.x * d.z;
        y[8] = H24 * (xx - yy);
    }
    if (DEGREE >= 3u) {
        y[9] = H30 * d.y * (3.0 * xx - yy);
        y[10] = H31 * d.x * d.y * d.z;
        y[11] = H32 * d.y * (4.0 * zz - xx - yy);
        y[12] = H33 * d.z * (2.0 * zz - 3.0 * xx - 3.0 * yy);
        y[13] = H34 * d.x * (4.0 * zz - xx - yy);
        y[14] = H35 * d.z * (xx - yy);
        y[15] = H36 * d.x * (xx - 3.0 * yy);
    }
    return y;
}

// ∂Y_k/∂d, before it is confined to the unit sphere.
fn slopes_of(d: vec3<f32>) -> array<vec3<f32>, 16> {
    var g: array<vec3<f32>, 16>;
    let x = d.x;
    let y = d.y;
    let z = d.z;
    g[0] = vec3(0.0);
    if (DEGREE >= 1u) {
        g[1] = vec3(0.0, -H1, 0.0);
        g[2] = vec3(0.0, 0.0, H1);
        g[3] = vec3(-H1, 0.0, 0.0);
    }
    if (DEGREE >= 2u) {
        g[4] = H20 * vec3(y, x, 0.0);
        g[5] = H21 * vec3(0.0, z, y);
        g[6] = H22 * vec3(-2.0 * x, -2.0 * y, 4.0 * z);
        g[7] = H23 * vec3(z, 0.0, x);
        g[8] = H24 * vec3(2.0 * x, -2.0 * y, 0.0);
    }
    if (DEGREE >= 3u) {
        let xx = x * x;
        let yy = y * y;
        let zz = z * z;
        g[9] = H30 * vec3(6.0 * x * y, 3.0 * (xx - yy), 0.0);
        g[10] = H31 * vec3(y * z, x * z, x * y);
        g[11] = H32 * vec3(-2.0 * x * y, 4.0 * zz - xx - 3.0 * yy, 8.0 * y * z);
        g[12] = H33 * vec3(-6.0 * x * z, -6.0 * y * z, 6.0 * zz - 3.0 * xx - 3.0 * yy);
        g[13] = H34 * vec3(4.0 * zz - 3.0 * xx - yy, -2.0 * x * y, 8.0 * x * z);
        g[14] = H35 * vec3(2.0 * x * z, -2.0 * y * z, xx - yy);
        g[15] = H36 * vec3(3.0 * (xx - yy), -6.0 * x * y, 0.0);
    }
    return g;
}
