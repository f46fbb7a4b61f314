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

// Σ_k w_k ∂Y_k/∂d, before it is confined to the unit sphere.
fn direction_gradient(d: vec3<f32>, w: array<f32, 16>, degree: u32) -> vec3<f32> {
    var g = vec3(0.0);
    let x = d.x;
    let y = d.y;
    let z = d.z;
    if (degree >= 1u) { g += vec3(-H1 * w[3], -H1 * w[1], H1 * w[2]); }
    if (degree >= 2u) {
        g += vec3(
            H20 * y * w[4] - 2.0 * H22 * x * w[6] + H23 * z * w[7] + 2.0 * H24 * x * w[8],
            H20 * x * w[4] + H21 * z * w[5] - 2.0 * H22 * y * w[6] - 2.0 * H24 * y * w[8],
            H21 * y * w[5] + 4.0 * H22 * z * w[6] + H23 * x * w[7],
        );
    }
    if (degree >= 3u) {
        g += vec3(
            H30 * 6.0 * x * y * w[9] + H31 * y * z * w[10] - H32 * 2.0 * x * y * w[11] - H33 * 6.0 * x * z * w[12]
                + H34 * (4.0 * z * z - 3.0 * x * x - y * y) * w[13] + H35 * 2.0 * x * z * w[14] + H36 * 3.0 * (x * x - y * y) * w[15],
            H30 * 3.0 * (x * x - y * y) * w[9] + H31 * x * z * w[10] + H32 * (4.0 * z * z - x * x - 3.0 * y * y) * w[11]
                - H33 * 6.0 * y * z * w[12] - H34 * 2.0 * x * y * w[13] - H35 * 2.0 * y * z * w[14] - H36 * 6.0 * x * y * w[15],
            H31 * x * y * w[10] + H32 * 8.0 * y * z * w[11] + H33 * (6.0 * z * z - 3.0 * x * x - 3.0 * y * y) * w[12]
                + H34 * 8.0 * x * z * w[13] + H35 * (x * x - y * y) * w[14],
        );
    }
    return g;
}
