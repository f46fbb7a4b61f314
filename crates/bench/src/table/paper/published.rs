//! The figures that the paper prints: CORF-GS, Tables I–IV. Rows and columns stand as they do there; times are in seconds.

use Figure::{LpipsOpt, LpipsRadio, PsnrOpt, PsnrRadio, SsimOpt, SsimRadio, Time};

/// A column of the paper's tables.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Figure {
    /// PSNR of the image, dB.
    PsnrOpt,
    /// SSIM of the image.
    SsimOpt,
    /// LPIPS of the image.
    LpipsOpt,
    /// PSNR of the Jet spectrum, dB.
    PsnrRadio,
    /// SSIM of the Jet spectrum.
    SsimRadio,
    /// LPIPS of the Jet spectrum.
    LpipsRadio,
    /// Reconstruction time, seconds.
    Time,
}

impl Figure {
    /// Keys under which records hold it, the preferred one first; time has a place of its own. LPIPS is that of VGG on inputs in `[0, 1]`, as
    /// RF-3DGS, whose evaluation the literature follows, computes it; else on inputs in `[−1, 1]`.
    pub fn keys(self) -> &'static [&'static str] {
        match self {
            PsnrOpt => &["psnr_opt"],
            SsimOpt => &["ssim_opt"],
            LpipsOpt => &["lpips_vgg_01_opt", "lpips_vgg_opt"],
            PsnrRadio => &["psnr_rf_jet"],
            SsimRadio => &["ssim_rf_jet"],
            LpipsRadio => &["lpips_vgg_01_rf_jet", "lpips_vgg_rf_jet"],
            Time => &[],
        }
    }

    /// Heading in Markdown.
    pub fn heading(self) -> &'static str {
        match self {
            PsnrOpt => "PSNR opt ↑",
            SsimOpt => "SSIM opt ↑",
            LpipsOpt => "LPIPS opt ↓",
            PsnrRadio => "PSNR rf ↑",
            SsimRadio => "SSIM rf ↑",
            LpipsRadio => "LPIPS rf ↓",
            Time => "time, s ↓",
        }
    }

    /// Heading in LaTeX.
    pub fn latex(self) -> &'static str {
        match self {
            PsnrOpt => r"PSNR$_\mathrm{opt}^\uparrow$",
            SsimOpt => r"SSIM$_\mathrm{opt}^\uparrow$",
            LpipsOpt => r"LPIPS$_\mathrm{opt}^\downarrow$",
            PsnrRadio => r"PSNR$_\mathrm{rf}^\uparrow$",
            SsimRadio => r"SSIM$_\mathrm{rf}^\uparrow$",
            LpipsRadio => r"LPIPS$_\mathrm{rf}^\downarrow$",
            Time => r"Time$^\downarrow$ (s)",
        }
    }

    /// Name in the CSV.
    pub fn name(self) -> &'static str {
        match self {
            PsnrOpt => "psnr_opt",
            SsimOpt => "ssim_opt",
            LpipsOpt => "lpips_opt",
            PsnrRadio => "psnr_rf",
            SsimRadio => "ssim_rf",
            LpipsRadio => "lpips_rf",
            Time => "seconds",
        }
    }

    /// Digits after the point.
    pub fn digits(self) -> usize {
        match self {
            PsnrOpt | PsnrRadio => 2,
            SsimOpt | SsimRadio | LpipsOpt | LpipsRadio => 3,
            Time => 1,
        }
    }
}

/// A method of the paper.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PaperMethod {
    /// NeRF².
    Nerf2,
    /// WRF-GS+.
    WrfGsPlus,
    /// RF-3DGS.
    Rf3dgs,
    /// CORF-GS, "Ours" in the paper.
    CorfGs,
    /// Ablation: uniform sampling.
    Uniform,
    /// Ablation: two stages, frozen geometry.
    Frozen,
    /// Ablation: two stages, geometry refined by RF in the second.
    RadioTuned,
}

/// Other method of this program that stands for the same row with another implementation: its id, and how it differs.
type Variant = (&'static str, &'static str);

impl PaperMethod {
    /// The method ids that stand for it here: the paper's row, and what is shown below it where there are records of it.
    pub fn methods(self) -> (&'static str, Option<Variant>) {
        match self {
            Self::Nerf2 => ("nerf2", Some(("nerf2-corrected", "corrected"))),
            Self::WrfGsPlus => ("wrf-gs-plus", Some(("wrf-gs-plus-corrected", "corrected"))),
            Self::Rf3dgs => ("rf-3dgs", Some(("rf-3dgs-corrected", "corrected"))),
            Self::CorfGs => ("corf-gs", Some(("corf-gs-paper", "the paper's constants"))),
            Self::Uniform => ("corf-gs-uniform", None),
            Self::Frozen => ("corf-gs-frozen", None),
            Self::RadioTuned => ("corf-gs-rf-tuned", None),
        }
    }

    /// Its budget's settings, as JSON pointers into a record's configuration: each by the names that it may have.
    pub fn budget(self) -> &'static [&'static [&'static str]] {
        match self {
            Self::Nerf2 | Self::WrfGsPlus => &[&["/iterations", "/steps"]],
            Self::Rf3dgs => &[&["/optical_steps"], &["/rf_steps"]],
            Self::CorfGs | Self::Uniform | Self::Frozen | Self::RadioTuned => {
                &[&["/reconstruction/iterations_per_keyframe"], &["/fine_tune_epochs"]]
            }
        }
    }
}

/// A row of a table of the paper.
#[derive(Clone, Copy, Debug)]
pub struct PaperRow {
    /// The row's name here: the paper's, with the budget where rows differ by it.
    pub name: &'static str,
    /// Its method.
    pub family: PaperMethod,
    /// Values of the settings of [`PaperMethod::budget`].
    pub budget: &'static [u64],
    /// The paper's figures, in the order of the table's columns.
    pub values: &'static [f64],
}

/// A table of the paper.
#[derive(Clone, Copy, Debug)]
pub struct PaperTable {
    /// Its number.
    pub number: &'static str,
    /// Its label in the paper's source.
    pub label: &'static str,
    /// Its subject.
    pub title: &'static str,
    /// Whether its rows are methods, each at its usual budget.
    pub compares_methods: bool,
    /// Columns.
    pub figures: &'static [Figure],
    /// Rows.
    pub rows: &'static [PaperRow],
}

const fn row(name: &'static str, family: PaperMethod, budget: &'static [u64], values: &'static [f64]) -> PaperRow {
    PaperRow { name, family, budget, values }
}

/// CORF-GS as the paper runs it: 75 iterations a keyframe, no fine-tuning.
pub const USUAL: (PaperMethod, &[u64]) = (PaperMethod::CorfGs, &[75, 0]);
/// Its PSNR rf (Table I, row "Ours").
pub const USUAL_PSNR_RADIO: f64 = 18.52;

/// Tables I–IV, as printed.
pub const TABLES: &[PaperTable] = &[
    // Table I, tab:baseline-results-metric: rows NeRF², WRF-GS+, RF-3DGS, Ours. Times there: 4:09:01, 0:42:20, 0:14:41, 0:02:18. Budgets from the
    // implementation details: 30 000, 10 000, (30 000, 10 000) iterations, and 75 a keyframe.
    PaperTable {
        number: "I",
        label: "tab:baseline-results-metric",
        title: "methods",
        compares_methods: true,
        figures: &[PsnrRadio, SsimRadio, LpipsRadio, Time],
        rows: &[
            row("NeRF²", PaperMethod::Nerf2, &[30_000], &[12.17, 0.594, 0.527, 14_941.0]),
            row("WRF-GS+", PaperMethod::WrfGsPlus, &[10_000], &[17.44, 0.839, 0.252, 2_540.0]),
            row("RF-3DGS", PaperMethod::Rf3dgs, &[30_000, 10_000], &[16.92, 0.788, 0.333, 881.0]),
            row("CORF-GS", PaperMethod::CorfGs, &[75, 0], &[18.52, 0.852, 0.239, 138.0]),
        ],
    },
    // Table II, tab:baseline-iter: WRF-GS+ by iterations, RF-3DGS by (optical, RF) iterations, Ours by iterations a keyframe.
    PaperTable {
        number: "II",
        label: "tab:baseline-iter",
        title: "budgets",
        compares_methods: false,
        figures: &[PsnrRadio, SsimRadio, LpipsRadio],
        rows: &[
            row("WRF-GS+, 5 000", PaperMethod::WrfGsPlus, &[5_000], &[16.75, 0.826, 0.271]),
            row("WRF-GS+, 10 000", PaperMethod::WrfGsPlus, &[10_000], &[17.44, 0.839, 0.252]),
            row("WRF-GS+, 20 000", PaperMethod::WrfGsPlus, &[20_000], &[17.96, 0.848, 0.243]),
            row("WRF-GS+, 30 000", PaperMethod::WrfGsPlus, &[30_000], &[18.09, 0.850, 0.243]),
            row("RF-3DGS, 15 000 + 10 000", PaperMethod::Rf3dgs, &[15_000, 10_000], &[17.19, 0.792, 0.320]),
            row("RF-3DGS, 15 000 + 25 000", PaperMethod::Rf3dgs, &[15_000, 25_000], &[17.70, 0.807, 0.307]),
            row("RF-3DGS, 15 000 + 40 000", PaperMethod::Rf3dgs, &[15_000, 40_000], &[17.88, 0.812, 0.303]),
            row("RF-3DGS, 30 000 + 10 000", PaperMethod::Rf3dgs, &[30_000, 10_000], &[16.92, 0.788, 0.333]),
            row("RF-3DGS, 30 000 + 25 000", PaperMethod::Rf3dgs, &[30_000, 25_000], &[17.38, 0.804, 0.319]),
            row("CORF-GS, 50 a keyframe", PaperMethod::CorfGs, &[50, 0], &[18.18, 0.843, 0.247]),
            row("CORF-GS, 75 a keyframe", PaperMethod::CorfGs, &[75, 0], &[18.52, 0.852, 0.239]),
            row("CORF-GS, 100 a keyframe", PaperMethod::CorfGs, &[100, 0], &[18.56, 0.854, 0.237]),
            row("CORF-GS, 125 a keyframe", PaperMethod::CorfGs, &[125, 0], &[18.65, 0.854, 0.236]),
        ],
    },
    // Table III, tab:finetune: Ours with 25 to 100 fine-tuning iterations, and RF-3DGS.
    PaperTable {
        number: "III",
        label: "tab:finetune",
        title: "offline fine-tuning",
        compares_methods: false,
        figures: &[PsnrOpt, SsimOpt, LpipsOpt, PsnrRadio, SsimRadio, LpipsRadio, Time],
        rows: &[
            row("CORF-GS, fine-tuned 25", PaperMethod::CorfGs, &[75, 25], &[38.13, 0.980, 0.069, 18.85, 0.862, 0.229, 191.69]),
            row("CORF-GS, fine-tuned 50", PaperMethod::CorfGs, &[75, 50], &[38.30, 0.980, 0.066, 18.96, 0.865, 0.226, 243.29]),
            row("CORF-GS, fine-tuned 75", PaperMethod::CorfGs, &[75, 75], &[38.63, 0.982, 0.064, 19.04, 0.867, 0.223, 295.47]),
            row("CORF-GS, fine-tuned 100", PaperMethod::CorfGs, &[75, 100], &[38.60, 0.982, 0.063, 19.09, 0.868, 0.223, 363.14]),
            row("RF-3DGS", PaperMethod::Rf3dgs, &[30_000, 10_000], &[38.39, 0.980, 0.062, 16.92, 0.788, 0.333, 881.0]),
        ],
    },
    // Table IV, tab:ablation: times there 0:07:15, 0:02:13, 0:02:31, 0:02:18.
    PaperTable {
        number: "IV",
        label: "tab:ablation",
        title: "ablations",
        compares_methods: false,
        figures: &[PsnrOpt, SsimOpt, LpipsOpt, PsnrRadio, SsimRadio, LpipsRadio, Time],
        rows: &[
            row(
                "w/o optical-guided expansion",
                PaperMethod::Uniform,
                &[75, 0],
                &[31.89, 0.966, 0.112, 15.69, 0.780, 0.317, 435.0],
            ),
            row("w/o joint (frozen geometry)", PaperMethod::Frozen, &[75, 0], &[37.23, 0.979, 0.076, 17.11, 0.798, 0.297, 133.0]),
            row(
                "w/o joint (RF-tuned geometry)",
                PaperMethod::RadioTuned,
                &[75, 0],
                &[36.72, 0.977, 0.080, 18.44, 0.836, 0.240, 151.0],
            ),
            row("CORF-GS (full)", PaperMethod::CorfGs, &[75, 0], &[37.14, 0.978, 0.077, 18.52, 0.852, 0.239, 138.0]),
        ],
    },
];
