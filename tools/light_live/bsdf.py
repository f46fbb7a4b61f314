"""corf's reflection model as a Mitsuba plugin, written from its published formulas alone.

    f(v, l) = D·G₂·F / (4 v_z l_z) + c_diff/π · (1 − E(v))(1 − E(l)) / (1 − Ē)

D is GGX with alpha = roughness², G₂ height-correlated Smith shadowing, F Schlick's term with F₀ = ((ior − 1)/(ior + 1))² towards the base
colour with metallic (glTF 2.0, appendix B), and the diffuse term that of Kelemen and Szirmay-Kalos (2001), in which E is the lobe's
directional albedo (of the largest channel of F₀) and Ē its cosine-weighted mean. E comes from a table of this module's own.
"""

from functools import cache

import drjit as dr
import mitsuba as mi
import numpy as np

NAME = "corf_coupled"
MIN_ALPHA = 1e-3
# Shading normals are at least this visible from where the light came.
MIN_VISIBLE_COS = 0.01
# Nodes of the table over the cosine and over the roughness, and directions per node.
COSINES, ROUGHNESSES = 96, 64
STRATA = (48, 64)


def smith_lambda(z, alpha):
    """Smith's Λ of GGX, NumPy."""
    z2 = np.maximum(z * z, 1e-14)
    return 0.5 * (np.sqrt(1 + alpha**2 * np.maximum(1 - z2, 0) / z2) - 1)


@cache
def albedo_table():
    """`E = F₀·scale + bias` at cosines (rows) and roughnesses: two arrays (ROUGHNESSES, COSINES), float64.

    Integrated over the normals that v sees: E is the mean of F·G₂/G₁ of the directions they reflect v into.
    """
    u1 = (np.arange(STRATA[0]) + 0.5) / STRATA[0]
    u2 = (np.arange(STRATA[1]) + 0.5) / STRATA[1]
    scale, bias = np.zeros((ROUGHNESSES, COSINES)), np.zeros((ROUGHNESSES, COSINES))
    cosines = np.maximum(np.arange(COSINES) / (COSINES - 1), 5e-4)
    for j in range(ROUGHNESSES):
        alpha = max((j / (ROUGHNESSES - 1)) ** 2, MIN_ALPHA)
        for i, v_z in enumerate(cosines):
            scale[j, i], bias[j, i] = _albedo(v_z, alpha, u1, u2)
    return scale, bias


def _albedo(v_z, alpha, u1, u2):
    """Visible normals by the hemisphere of stretched views (Heitz 2018), weight G₂/G₁."""
    v = np.array([np.sqrt(max(1 - v_z * v_z, 0)), 0, v_z])
    stretched = np.array([alpha * v[0], 0, v[2]])
    stretched /= np.linalg.norm(stretched)
    t1 = np.array([0.0, 1.0, 0.0])
    t2 = np.cross(stretched, t1)
    r, phi = np.sqrt(u1)[:, None], 2 * np.pi * u2[None, :]
    p1, p2 = r * np.cos(phi), r * np.sin(phi)
    s = 0.5 * (1 + stretched[2])
    p2 = (1 - s) * np.sqrt(np.maximum(1 - p1 * p1, 0)) + s * p2
    p3 = np.sqrt(np.maximum(1 - p1 * p1 - p2 * p2, 0))
    h = [p1 * t1[k] + p2 * t2[k] + p3 * stretched[k] for k in range(3)]
    h = [alpha * h[0], alpha * h[1], np.maximum(h[2], 1e-9)]
    norm = np.sqrt(h[0] ** 2 + h[1] ** 2 + h[2] ** 2)
    v_h = (v[0] * h[0] + v[2] * h[2]) / norm
    l_z = 2 * v_h * h[2] / norm - v_z
    up = l_z > 0
    lv, ll = smith_lambda(v_z, alpha), smith_lambda(np.where(up, l_z, 1.0), alpha)
    weight = np.where(up, (1 + lv) / (1 + lv + ll), 0.0)
    m5 = np.clip(1 - v_h, 0, 1) ** 5
    return (weight * (1 - m5)).mean(), (weight * m5).mean()


class Table:
    """The table on Mitsuba's side, bilinear in cosine and roughness."""

    def __init__(self):
        scale, bias = albedo_table()
        mu = np.arange(COSINES) / (COSINES - 1)
        means = [np.trapezoid(2 * t * mu, mu, axis=1) for t in (scale, bias)]
        both = np.stack([scale, bias], axis=-1).astype(np.float32)
        self.albedo = mi.Texture2f(mi.TensorXf(both), filter_mode=dr.FilterMode.Linear, wrap_mode=dr.WrapMode.Clamp)
        self.means = mi.Texture1f(
            mi.TensorXf(np.stack(means, axis=-1).astype(np.float32)),
            filter_mode=dr.FilterMode.Linear,
            wrap_mode=dr.WrapMode.Clamp,
        )

    def at(self, z, roughness, active):
        """`(scale, bias)` at a cosine."""
        x = (dr.clip(z, 0, 1) * (COSINES - 1) + 0.5) / COSINES
        return self.albedo.eval(mi.Point2f(x, self._row(roughness)), active)

    def mean(self, roughness, active):
        """Their cosine-weighted means."""
        return self.means.eval(mi.Point1f(self._row(roughness)), active)

    @staticmethod
    def _row(roughness):
        return (dr.clip(roughness, 0, 1) * (ROUGHNESSES - 1) + 0.5) / ROUGHNESSES


@cache
def table():
    return Table()


class Point:
    """A place of the surface: its frame, parameters and what does not depend on the outgoing direction."""

    def __init__(self, bsdf, si, active):
        wi = si.to_world(si.wi)
        self.side = dr.select(dr.dot(si.n, wi) >= 0, mi.Float(1), mi.Float(-1))
        self.n_g = si.n * self.side
        n = si.sh_frame.n
        n = dr.select(dr.dot(n, si.n) < 0, -n, n)
        if bsdf.normal_map is not None:
            m = 2 * mi.Vector3f(bsdf.normal_map.eval_3(si, active)) - 1
            t = dr.normalize(si.dp_du - n * dr.dot(n, si.dp_du))
            b = dr.cross(n, t)
            # glTF: green points against v.
            b = dr.select(dr.dot(b, si.dp_dv) < 0, b, -b)
            n = dr.normalize(t * m.x + b * m.y + n * m.z)
        n = n * self.side
        seen = dr.dot(n, wi)
        n = dr.select(seen >= MIN_VISIBLE_COS, n, dr.normalize(n - wi * (seen - MIN_VISIBLE_COS)))
        self.frame = mi.Frame3f(n)
        self.v = self.frame.to_local(wi)
        base = dr.clip(bsdf.base_color.eval(si, active), 0, 1)
        metallic = dr.clip(bsdf.metallic.eval_1(si, active), 0, 1)
        self.alpha = dr.maximum(dr.square(dr.clip(bsdf.roughness.eval_1(si, active), 0, 1)), MIN_ALPHA)
        self.roughness = dr.sqrt(self.alpha)
        self.f0 = dr.lerp(mi.Color3f(bsdf.dielectric_f0), base, metallic)
        self.diffuse = base * (1 - metallic)
        self.f0_max = dr.max(self.f0)
        scale, bias = table().at(self.v.z, self.roughness, active)
        mean_scale, mean_bias = table().mean(self.roughness, active)
        self.under_view = dr.maximum(1 - (self.f0_max * scale + bias), 0) / dr.maximum(
            1 - (self.f0_max * mean_scale + mean_bias), 1e-4
        )
        s = mi.luminance(self.f0 * scale + bias)
        d = mi.luminance(self.diffuse) * dr.maximum(1 - (self.f0_max * scale + bias), 0)
        self.lobe = dr.select(d <= 0, mi.Float(1), dr.clip(s / (s + d), 0.1, 0.9))

    def smith_lambda(self, z):
        z2 = dr.maximum(z * z, 1e-12)
        return 0.5 * (dr.sqrt(1 + dr.square(self.alpha) * dr.maximum(1 - z2, 0) / z2) - 1)

    def evaluate(self, l, active):
        """`f·cos` and density of a direction in the shading frame."""
        v, a2 = self.v, dr.square(self.alpha)
        h = dr.normalize(v + l)
        v_h = dr.clip(dr.dot(v, h), 0, 1)
        c2 = dr.square(h.z)
        d = a2 / (dr.pi * dr.maximum(dr.square(c2 * a2 + dr.maximum(1 - c2, 0)), 1e-30))
        lv, ll = self.smith_lambda(v.z), self.smith_lambda(l.z)
        m = 1 - v_h
        fresnel = self.f0 + (1 - self.f0) * (dr.square(dr.square(m)) * m)
        specular = fresnel * d / ((1 + lv + ll) * 4 * v.z)
        scale, bias = table().at(l.z, self.roughness, active)
        coupling = self.under_view * dr.maximum(1 - (self.f0_max * scale + bias), 0)
        diffuse = self.diffuse * (dr.inv_pi * l.z * coupling)
        pdf = self.lobe * d / ((1 + lv) * 4 * v.z) + (1 - self.lobe) * dr.inv_pi * l.z
        up = active & (l.z > 0) & (v.z > 0)
        return dr.select(up, specular + diffuse, 0), dr.select(up, pdf, 0)

    def visible_normal(self, u):
        """A GGX normal as seen from v (Heitz 2018)."""
        s = dr.normalize(mi.Vector3f(self.alpha * self.v.x, self.alpha * self.v.y, self.v.z))
        length2 = dr.square(s.x) + dr.square(s.y)
        t1 = dr.select(
            length2 > 1e-14, mi.Vector3f(-s.y, s.x, 0) * dr.rsqrt(dr.maximum(length2, 1e-20)), mi.Vector3f(1, 0, 0)
        )
        t2 = dr.cross(s, t1)
        r, phi = dr.sqrt(u.x), dr.two_pi * u.y
        p1, p2 = r * dr.cos(phi), r * dr.sin(phi)
        mix = 0.5 * (1 + s.z)
        p2 = dr.lerp(dr.safe_sqrt(1 - p1 * p1), p2, mix)
        h = t1 * p1 + t2 * p2 + s * dr.safe_sqrt(1 - p1 * p1 - p2 * p2)
        return dr.normalize(mi.Vector3f(self.alpha * h.x, self.alpha * h.y, dr.maximum(h.z, 1e-9)))


class Coupled(mi.BSDF):
    """The reflection of every opaque surface, seen from both sides."""

    def __init__(self, props):
        mi.BSDF.__init__(self, props)
        self.base_color = props.get_texture("base_color", 0.8)
        self.roughness = props.get_texture("roughness", 1.0)
        self.metallic = props.get_texture("metallic", 0.0)
        self.normal_map = props.get_texture("normalmap") if "normalmap" in props else None
        ior = props.get("ior", 1.5)
        self.dielectric_f0 = ((ior - 1) / (ior + 1)) ** 2
        both = mi.BSDFFlags.FrontSide | mi.BSDFFlags.BackSide
        self.m_components = [mi.BSDFFlags.DiffuseReflection | both, mi.BSDFFlags.GlossyReflection | both]
        self.m_flags = mi.BSDFFlags.DiffuseReflection | mi.BSDFFlags.GlossyReflection | both

    def traverse(self, callback):
        for name in ("base_color", "roughness", "metallic"):
            callback.put(name, getattr(self, name), mi.ParamFlags.Differentiable)

    def _pair(self, point, si, wo, active):
        out = si.to_world(wo)
        value, pdf = point.evaluate(point.frame.to_local(out), active)
        seen = dr.dot(point.n_g, out) > 0
        return dr.select(seen, value, 0), dr.select(seen, pdf, 0)

    def sample(self, ctx, si, sample1, sample2, active=True):
        point = Point(self, si, active)
        mirror = sample1 < point.lobe
        h = point.visible_normal(sample2)
        toward = dr.select(mirror, mi.reflect(point.v, h), mi.warp.square_to_cosine_hemisphere(sample2))
        value, pdf = point.evaluate(toward, active)
        out = point.frame.to_world(toward)
        good = active & (pdf > 0) & (dr.dot(point.n_g, out) > 0)
        bs = dr.zeros(mi.BSDFSample3f)
        bs.wo = si.to_local(out)
        bs.pdf = dr.select(good, pdf, 0)
        bs.eta = 1
        bs.sampled_type = mi.UInt32(+mi.BSDFFlags.GlossyReflection)
        bs.sampled_component = 1
        return bs, dr.select(good, value / pdf, 0)

    def eval(self, ctx, si, wo, active=True):
        return self._pair(Point(self, si, active), si, wo, active)[0]

    def pdf(self, ctx, si, wo, active=True):
        return self._pair(Point(self, si, active), si, wo, active)[1]

    def eval_pdf(self, ctx, si, wo, active=True):
        return self._pair(Point(self, si, active), si, wo, active)

    def to_string(self):
        return "Coupled[]"


mi.register_bsdf(NAME, Coupled)
