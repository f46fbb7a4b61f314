//! Cached light on the GPU: tiles of lattices in pages of memory, filled when paths ask for them.
//!
//! The coarse lattice is solved first. A pass of the renderer marks the slots of tiles that it lacks; they are given memory here,
//! filled by kernels, and the pixels that lacked them are begun again. A tile depends on its key alone, so it does not matter
//! when and with which others it is filled.

use super::super::cache::{Job, Packed};
use super::super::records;
use super::pace::Pace;
use super::params::{MOST_FIELDS, Params, halves};
use super::scene::upload;
use super::shaders::{self, PAGES, PageSize};
use super::{GROUP, GpuLight};
use corf_gpu::{Bound, Context, Kernel};
use corf_scene::{Error, Result};

/// A tile of a lattice as one of the devices fills it, for tests: the words of its points, and its rough cells.
#[cfg(test)]
pub type Tile = (Vec<u32>, u64);

/// Points of a tile at most.
const MOST_POINTS: u32 = 81;
/// Bytes of a site and of a candidate.
const SITE_BYTES: u64 = 48;
const CANDIDATE_BYTES: u64 = 16;
/// Points of the coarse lattice that are worked on together, enough to fill a large GPU: 57 MB of sites.
const COARSE_POINTS: u32 = 65_536;
/// Tiles that are filled together, and bytes of the candidates of all of them at most.
const TOGETHER: usize = 4096;
const MOST_CANDIDATE_BYTES: u64 = 64 << 20;
/// Shadow rays and walks of a dispatch, at first.
const RAYS_AT_ONCE: u32 = 4 << 20;
const WALKS_AT_ONCE: u32 = 2 << 20;
/// Bytes of a page at most, and of its first piece.
const PAGE_BYTES: u64 = 512 << 20;
const FIRST_PAGE_BYTES: u64 = 4 << 20;
/// Bytes of a word of a page.
const WORD_BYTES: u64 = 16;

/// Tiles and where they lie.
pub(super) struct Lattices<'a> {
    packed: Packed<'a>,
    /// Charts, lattices and slots, as renderers bind them.
    charts: wgpu::Buffer,
    lattices: wgpu::Buffer,
    pub slots: wgpu::Buffer,
    members: wgpu::Buffer,
    jobs: wgpu::Buffer,
    sites: wgpu::Buffer,
    candidates: wgpu::Buffer,
    pages: Vec<wgpu::Buffer>,
    /// Stands for pages that are not there yet.
    no_page: wgpu::Buffer,
    page: PageSize,
    /// First free word of the pages.
    next: u32,
    /// Number of times that a page moved: what is bound to them has to be bound again.
    pub moves: u32,
    together: usize,
    bound: Option<(u32, [Bound; 5])>,
}

/// Kernels that fill tiles.
pub(super) struct TileKernels {
    /// Sites, candidates, direct, gather, rough.
    lattices: [Kernel; 5],
    /// Around, candidates, direct, links.
    coarse: [Kernel; 4],
}

impl TileKernels {
    pub fn new(context: &Context, constants: &str, page: PageSize) -> Result<Self> {
        let c = constants;
        let [sites, candidates, direct, gather, rough, around, coarse_candidates, coarse_direct, links] = Kernel::all(
            context,
            [
                ("light: sites", shaders::sites(c, page)),
                ("light: candidates", shaders::candidates(c, page)),
                ("light: direct", shaders::direct(c, page)),
                ("light: gather", shaders::gather(c, page)),
                ("light: rough", shaders::rough(c, page)),
                ("light: around", shaders::around(c, page)),
                ("light: coarse candidates", shaders::coarse_candidates(c, page)),
                ("light: coarse direct", shaders::coarse_direct(c, page)),
                ("light: links", shaders::links(c, page)),
            ],
        )?;
        let lattices = [sites, candidates, direct, gather, rough];
        Ok(Self { lattices, coarse: [around, coarse_candidates, coarse_direct, links] })
    }
}

/// Size of pages on an adapter.
pub(super) fn page_size(context: &Context) -> PageSize {
    PageSize { bits: (context.largest_buffer().min(PAGE_BYTES) / WORD_BYTES).ilog2() }
}

impl<'a> Lattices<'a> {
    /// Brings a scene's cache to the GPU and solves its coarse lattice; `None` where `tell` said no.
    pub fn new(gpu: &GpuLight<'_>, packed: Packed<'a>, report: &dyn Fn(usize, usize) -> bool) -> Result<Option<Self>> {
        let context = &gpu.context;
        let page = page_size(context);
        let (charts, members) = packed.chart_records(&gpu.scene.place_of);
        let emitters = u64::from(gpu.params.emitters.max(1));
        let together = TOGETHER.min((MOST_CANDIDATE_BYTES / (CANDIDATE_BYTES * emitters)).max(1) as usize);
        let storage = |label, bytes| context.storage(label, bytes);
        let mut lattices = Self {
            charts: upload(context, "charts", &charts)?,
            members: upload(context, "charts' triangles", &members)?,
            lattices: upload(context, "lattices", &packed.lattices())?,
            slots: storage("tiles of light", 4 * u64::from(packed.slots().max(1)))?,
            jobs: storage("tiles to fill", (size_of::<records::Job>() * together) as u64)?,
            sites: storage("sites of tiles", SITE_BYTES * u64::from(MOST_POINTS) * together as u64)?,
            candidates: storage("candidates of tiles", CANDIDATE_BYTES * emitters * together as u64)?,
            no_page: storage("no page", 256)?,
            pages: Vec::new(),
            page,
            next: 0,
            moves: 0,
            together,
            bound: None,
            packed,
        };
        Ok(lattices.solve(gpu, report)?.then_some(lattices))
    }

    /// Light below this counts as this much where cells are judged.
    pub fn dark(&self) -> f32 {
        self.packed.dark()
    }

    /// What all passes have to know of lattices.
    pub fn params(packed: &Packed<'_>, params: &Params) -> Result<Params> {
        let [direct_fields, indirect_fields] = packed.levels();
        let mut spacing_m = [[0.0; 4]; MOST_FIELDS];
        let spacings = packed.spacings_m();
        if spacings.len() > MOST_FIELDS {
            let what = format!("{} lattices of light, one finer than the other", spacings.len());
            return Err(Error::invalid("gpu", what, "choose --device cpu"));
        }
        for (slot, spacing) in spacing_m.iter_mut().zip(&spacings) {
            slot[0] = *spacing;
        }
        let background = packed.settings().background;
        Ok(Params { charts: packed.charts(), direct_fields, indirect_fields, spacing_m, background, ..*params })
    }

    /// Number of tiles that there may be.
    pub fn slot_count(&self) -> u32 {
        self.packed.slots()
    }

    /// Solves the coarse lattice: direct light and walks here, what they pass on on the processor. `tell` is told how many of how
    /// many tiles are done; when it
    /// answers `false`, the work is given up and so is the answer.
    fn solve(&mut self, gpu: &GpuLight<'_>, report: &dyn Fn(usize, usize) -> bool) -> Result<bool> {
        let context = &gpu.context;
        let settings = *self.packed.settings();
        let walks = settings.coarse_walks.max(1);
        let mut jobs: Vec<(Job, u32)> = (0..self.packed.coarse_slots()).map(|slot| (self.packed.job(slot), 0)).collect();
        let mut states = vec![0u32; self.packed.slots().max(1) as usize];
        let mut points = 0;
        for (job, first_point) in &mut jobs {
            let count = job.points.element_product();
            let head = self.allocate(context, 1 + 3 * count)?;
            (*first_point, points) = (points, points + count);
            states[job.slot as usize] = head + shaders::FILLED;
        }
        let head = |slot: u32| states[slot as usize] - shaders::FILLED;
        context.fill(&self.slots, 0, &states);
        let mut image = vec![0u32; 4 * self.next as usize];
        for (job, first_point) in &jobs {
            image[4 * head(job.slot) as usize + 2] = *first_point;
        }
        self.upload(context, &image);
        // What is sealed is dark as it stands.
        jobs.retain(|(job, _)| !self.packed.is_sealed(job));
        // As many tiles together as the memory of their sites allows: the largest charts come first.
        let mut batches: Vec<&[(Job, u32)]> = Vec::new();
        let mut rest = &jobs[..];
        while !rest.is_empty() {
            let mut most = 0;
            let mut fits = |(k, (job, _)): (usize, &(Job, u32))| {
                most = most.max(job.points.element_product());
                k == 0 || k < self.together && (k as u32 + 1) * most <= COARSE_POINTS
            };
            let count = rest.iter().enumerate().take_while(|entry| fits(*entry)).count();
            let (batch, others) = rest.split_at(count);
            batches.push(batch);
            rest = others;
        }
        let site_bytes = SITE_BYTES * u64::from(shaders::COARSE_SITES * COARSE_POINTS);
        let link_bytes = WORD_BYTES * u64::from((walks + 3) * COARSE_POINTS);
        let scratch = [context.storage("sites of light", site_bytes)?, context.storage("walks of light", link_bytes)?];
        let bind = |kernel: &Kernel, last: &wgpu::Buffer| {
            let own = [&self.charts, &self.lattices, &self.slots, &self.members, &self.jobs, &scratch[0], last];
            gpu.bind(kernel, &own.into_iter().chain(self.page_buffers()).collect::<Vec<_>>())
        };
        let [around, candidates, direct, links] = &gpu.tile_kernels()?.coarse;
        let [around, candidates, direct] =
            [bind(around, &self.candidates)?, bind(candidates, &self.candidates)?, bind(direct, &self.candidates)?];
        let links = bind(links, &scratch[1])?;
        let all = 2 * jobs.len();
        let mut done = 0;
        let mut found: Vec<u32> = Vec::with_capacity(points as usize * 4 * (walks as usize + 3));
        for is_direct in [true, false] {
            for batch in &batches {
                if !report(done, all) {
                    return Ok(false);
                }
                let most = batch.iter().map(|(job, _)| job.points.element_product()).max().unwrap_or(1);
                let mut own = 0;
                let mut records = Vec::with_capacity(batch.len());
                for (job, first_point) in *batch {
                    let record = record_of(job, head(job.slot));
                    records.push(records::Job { first_point: *first_point, first_record: own, ..record });
                    own += job.points.element_product();
                }
                context.fill(&self.jobs, 0, &records);
                let count = batch.len() as u32;
                let params = Params {
                    seed: halves(settings.seed),
                    background: settings.background,
                    count,
                    points: most,
                    rays: if is_direct { settings.coarse_rays.max(1) } else { walks },
                    list: u32::from(!is_direct),
                    ..gpu.params
                };
                let mut commands = gpu.commands("gpu: coarse solution");
                commands.run(&around, &params, (count * most).div_ceil(GROUP));
                if is_direct {
                    commands.run(&candidates, &params, count);
                    commands.run(&direct, &params, count * most);
                    commands.submit();
                    context.check("solving light")?;
                } else {
                    commands.run(&links, &params, count * most);
                    commands.submit();
                    let read = context.read::<u32>("solving light", &[(&scratch[1], (own * (walks + 3)) as usize * 4)])?;
                    found.extend(&read[0]);
                }
                done += batch.len();
            }
        }
        // Direct light lies in the pages, in the order of the points, with a head in front of each tile.
        let mut pages = Vec::new();
        for page in &self.pages {
            pages.push(context.read::<u32>("solving light", &[(page, page.size() as usize / 4)])?.remove(0));
        }
        let mut received = Vec::with_capacity(points as usize * 12);
        for (job, _) in &jobs {
            let (page, at) = self.place(head(job.slot));
            received.extend(&pages[page][4 * (at + 1)..][..12 * job.points.element_product() as usize]);
        }
        drop(pages);
        self.packed.solve(&received, &found);
        for (slot, words) in self.packed.coarse() {
            image[4 * (head(slot) as usize + 1)..][..words.len()].copy_from_slice(&words);
        }
        self.upload(context, &image);
        context.check("solving light")?;
        Ok(report(all, all))
    }

    /// Page and place in it of a word.
    fn place(&self, word: u32) -> (usize, usize) {
        ((word >> self.page.bits) as usize, (word & ((1 << self.page.bits) - 1)) as usize)
    }

    /// Writes the pages from their first word on.
    fn upload(&self, context: &Context, image: &[u32]) {
        for (page, words) in self.pages.iter().zip(image.chunks(4 << self.page.bits)) {
            context.fill(page, 0, words);
        }
    }

    /// Memory for so many words, never across pages: its first word.
    fn allocate(&mut self, context: &Context, words: u32) -> Result<u32> {
        let size = 1u32 << self.page.bits;
        let mut at = self.next & (size - 1);
        if at + words > size || (at == 0 && self.next > 0) {
            self.next = self.next.next_multiple_of(size);
            at = 0;
        }
        let page = (self.next >> self.page.bits) as usize;
        if page >= PAGES {
            let what = format!("cached light takes more than {} MiB", (PAGES as u64 * WORD_BYTES * u64::from(size)) >> 20);
            let place = format!("gpu ({})", context.info.name);
            return Err(Error::invalid(place, what, "ask for fewer pixels, or choose --device cpu"));
        }
        let needed = WORD_BYTES * u64::from(at + words);
        let held = self.pages.get(page).map_or(0, wgpu::Buffer::size);
        if held < needed {
            let bytes = needed.max(2 * held).max(FIRST_PAGE_BYTES).min(WORD_BYTES << self.page.bits);
            let larger = context.storage("a page of light", bytes)?;
            if let Some(old) = self.pages.get(page) {
                let mut encoder = context.encoder();
                encoder.copy_buffer_to_buffer(old, 0, &larger, 0, held);
                context.submit(encoder);
                self.pages[page] = larger;
            } else {
                self.pages.push(larger);
            }
            self.moves += 1;
        }
        self.next += words;
        Ok((page as u32) << self.page.bits | at)
    }

    fn page_buffers(&self) -> impl Iterator<Item = &wgpu::Buffer> {
        self.pages.iter().chain(std::iter::repeat_n(&self.no_page, PAGES - self.pages.len()))
    }

    /// What a renderer binds behind its own buffers.
    pub fn for_renderer(&self) -> Vec<&wgpu::Buffer> {
        [&self.charts, &self.lattices, &self.slots].into_iter().chain(self.page_buffers()).collect()
    }

    fn bind(&mut self, gpu: &GpuLight<'_>) -> Result<&[Bound; 5]> {
        if self.bound.as_ref().is_none_or(|(moves, _)| *moves != self.moves) {
            let own = [&self.charts, &self.lattices, &self.slots, &self.members, &self.jobs, &self.sites, &self.candidates];
            let buffers: Vec<&wgpu::Buffer> = own.into_iter().chain(self.page_buffers()).collect();
            let [a, b, c, d, e] = &gpu.tile_kernels()?.lattices;
            let bind = |kernel: &Kernel| gpu.bind(kernel, &buffers);
            self.bound = Some((self.moves, [bind(a)?, bind(b)?, bind(c)?, bind(d)?, bind(e)?]));
        }
        match &self.bound {
            Some((_, bound)) => Ok(bound),
            None => unreachable!("bound above"),
        }
    }

    /// Fills the tiles of some slots.
    pub fn fill(&mut self, gpu: &GpuLight<'_>, pace: &Pace, params: &Params, mut slots: Vec<u32>) -> Result<()> {
        slots.sort_unstable();
        let direct_end = 1 + params.direct_fields;
        let jobs: Vec<Job> = slots.iter().map(|slot| self.packed.job(*slot)).collect();
        let (direct, indirect): (Vec<Job>, Vec<Job>) = jobs.into_iter().partition(|job| job.field < direct_end);
        for (jobs, is_direct) in [(direct, true), (indirect, false)] {
            for jobs in jobs.chunks(self.together) {
                self.fill_some(gpu, pace, params, jobs, is_direct)?;
            }
        }
        Ok(())
    }

    fn fill_some(&mut self, gpu: &GpuLight<'_>, pace: &Pace, params: &Params, jobs: &[Job], is_direct: bool) -> Result<()> {
        let context = &gpu.context;
        let mut filling = Vec::with_capacity(jobs.len());
        for job in jobs {
            filling.push(record_of(job, self.allocate(context, 1 + 3 * job.points.element_product())?));
        }
        context.fill(&self.jobs, 0, &filling);
        let settings = *self.packed.settings();
        let count = jobs.len() as u32;
        let rays = if is_direct { settings.direct_rays } else { settings.gather_walks };
        let points = jobs.iter().map(|job| job.points.element_product()).max().unwrap_or(1);
        let params = Params {
            seed: halves(settings.seed),
            background: settings.background,
            dark: self.dark(),
            points,
            count,
            first: 0,
            rays: rays.max(1),
            ..*params
        };
        let [sites, candidates, direct, gather, rough] = self.bind(gpu)?;
        let mut commands = gpu.commands(if is_direct { "gpu: direct tiles" } else { "gpu: indirect tiles" });
        commands.run(sites, &params, (count * points).div_ceil(GROUP));
        let (filler, at_once) = if is_direct {
            commands.run(candidates, &params, count);
            (direct, RAYS_AT_ONCE)
        } else {
            (gather, WALKS_AT_ONCE)
        };
        let at_once = (pace.scaled(at_once) / points.saturating_mul(params.rays)).max(1);
        for first in (0..count).step_by(at_once as usize) {
            commands.run(filler, &Params { first, ..params }, at_once.min(count - first) * points);
            if first + at_once < count {
                commands.submit();
            }
        }
        commands.run(rough, &params, count);
        commands.submit();
        context.check("filling tiles of light")
    }
}

/// A job as kernels read it.
fn record_of(job: &Job, head: u32) -> records::Job {
    let Job { field, chart, side, number, first, points, slot } = *job;
    let (first, points) = (first.to_array(), points.to_array());
    records::Job { field, chart, side, number, first, points, head, slot, ..Default::default() }
}

#[cfg(test)]
impl Lattices<'_> {
    /// What the coarse lattice holds here and what the processor's solution `cache` has: words of points.
    pub fn both_coarse(&self, cache: super::super::LightCache<'_>) -> Result<[Vec<u32>; 2]> {
        let flat = |packed: &Packed<'_>| packed.coarse().flat_map(|(_, words)| words).collect::<Vec<u32>>();
        Ok([flat(&self.packed), flat(&Packed::of(cache)?)])
    }

    /// The first `most` tiles of a field that have some points, filled here and by the processor: their points' words and their
    /// rough cells.
    pub fn both(&mut self, gpu: &GpuLight<'_>, params: &Params, field: u32, most: usize) -> Result<Vec<[Tile; 2]>> {
        let slots: Vec<u32> =
            (0..self.packed.slots()).filter(|slot| self.packed.job(*slot).field == field).step_by(7).take(most).collect();
        self.fill(gpu, &Pace::default(), params, slots.clone())?;
        let states = gpu.context.read::<u32>("reading tiles", &[(&self.slots, self.packed.slots() as usize)])?.remove(0);
        let page = gpu.context.read::<u32>("reading tiles", &[(&self.pages[0], self.pages[0].size() as usize / 4)])?.remove(0);
        let both = |slot: u32| {
            let job = self.packed.job(slot);
            let head = 4 * (states[slot as usize] - shaders::FILLED) as usize;
            let rough = u64::from(page[head]) | u64::from(page[head + 1]) << 32;
            let words = page[head + 4..head + 4 + 12 * job.points.element_product() as usize].to_vec();
            [(words, rough), self.packed.filled(&job)]
        };
        Ok(slots.into_iter().map(both).collect())
    }
}
