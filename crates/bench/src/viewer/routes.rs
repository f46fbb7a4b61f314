//! What the local server answers: a fixed table of routes. No path of a request reaches the file system.

use super::page;
use super::points;
use super::scene::SceneDocument;
use super::subject::Subject;
use anyhow::Result;
use std::sync::{Arc, Weak};

/// One thing that can be asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Route {
    /// The page.
    Page,
    /// The scene document.
    Scene,
    /// The Gaussians.
    Field,
    /// How far a reconstruction at work is; `asks` for a snapshot of its field.
    Growth { asks: bool },
    /// The points of a modality's sparse model.
    Points(&'static str),
    /// The document of a keyframe, by index.
    Keyframe(usize),
}

impl Route {
    /// The route of a request's target; `None` where there is none.
    pub(super) fn of(target: &str, keyframes: usize) -> Option<Self> {
        match target.split('?').next()? {
            "/" => Some(Self::Page),
            "/data/scene" => Some(Self::Scene),
            "/data/field" => Some(Self::Field),
            "/data/growth" => Some(Self::Growth { asks: true }),
            "/data/progress" => Some(Self::Growth { asks: false }),
            "/data/points-optical" => Some(Self::Points("optical")),
            "/data/points-rf" => Some(Self::Points("rf")),
            path => {
                let number = path.strip_prefix("/data/keyframe-")?;
                let digits = !number.is_empty() && number.bytes().all(|b| b.is_ascii_digit());
                let number: usize = digits.then(|| number.parse().ok()).flatten()?;
                (1..=keyframes).contains(&number).then(|| Self::Keyframe(number - 1))
            }
        }
    }
}

/// Whether a request's target leads to something, of a data set with so many keyframes.
pub fn leads_somewhere(target: &str, keyframes: usize) -> bool {
    Route::of(target, keyframes).is_some()
}

/// What an answer may load unless it is the page: nothing.
const NOTHING: &str = "default-src 'none'; base-uri 'none'; form-action 'none'";

/// An answer.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Answer {
    /// Status of HTTP.
    pub status: u16,
    /// Media type.
    pub kind: &'static str,
    /// Content, which all who are sent it share.
    pub body: Arc<Vec<u8>>,
    /// Version of the content, where there are several.
    pub version: Option<u64>,
    /// What a browser may load for it.
    pub policy: &'static str,
}

impl Answer {
    fn of(kind: &'static str, body: Arc<Vec<u8>>) -> Self {
        Self { status: 200, kind, body, version: None, policy: NOTHING }
    }

    /// A line of text.
    pub fn text(status: u16, text: &str) -> Self {
        Self { status, ..Self::of("text/plain; charset=utf-8", Arc::new(format!("{text}\n").into_bytes())) }
    }

    /// A page that says one thing.
    pub fn notice(status: u16, text: &str) -> Self {
        Self { status, ..Self::of(HTML, Arc::new(page::notice(text).into_bytes())) }
    }
}

const HTML: &str = "text/html; charset=utf-8";

/// What answers: a subject, and the contents that somebody is being sent.
pub(super) struct Desk<'s> {
    subject: &'s mut Subject,
    /// Contents that never change, by route, as long as somebody is sent them: who asks meanwhile is sent the same.
    under_way: Vec<(Route, Weak<Vec<u8>>)>,
}

impl<'s> Desk<'s> {
    pub fn new(subject: &'s mut Subject) -> Self {
        Self { subject, under_way: Vec::new() }
    }

    /// Answers a request's target; what goes wrong inside is an answer too.
    pub fn answer(&mut self, target: &str) -> Answer {
        let route = Route::of(target, self.subject.dataset.len());
        let answered = route.map_or(Ok(None), |route| self.content(route));
        match answered {
            Ok(answer) => answer.unwrap_or_else(|| Answer::text(404, "there is nothing here")),
            Err(error) => Answer::text(500, &format!("{error:#}")),
        }
    }

    /// The content of a route that never changes.
    fn once(&mut self, route: Route, make: impl FnOnce(&mut Subject) -> Result<Vec<u8>>) -> Result<Arc<Vec<u8>>> {
        self.under_way.retain(|(_, body)| body.strong_count() > 0);
        if let Some(body) = self.under_way.iter().find(|(of, _)| *of == route).and_then(|(_, body)| body.upgrade()) {
            return Ok(body);
        }
        let body = Arc::new(make(self.subject)?);
        self.under_way.push((route, Arc::downgrade(&body)));
        Ok(body)
    }

    /// The content of a route; none where the subject has no such thing.
    fn content(&mut self, route: Route) -> Result<Option<Answer>> {
        let json = |body: Arc<Vec<u8>>| Answer::of("application/json", body);
        let binary = |body: Arc<Vec<u8>>| Answer::of("application/octet-stream", body);
        let growth = self.subject.work.as_ref().map(|work| work.growth.clone());
        Ok(Some(match route {
            Route::Page => {
                let html = page::served(&SceneDocument::of(self.subject)?);
                Answer { policy: page::SERVED_POLICY, ..Answer::of(HTML, Arc::new(html.into_bytes())) }
            }
            Route::Scene => json(Arc::new(serde_json::to_vec(&SceneDocument::of(self.subject)?)?)),
            Route::Growth { asks } => {
                let Some(growth) = growth else { return Ok(None) };
                json(Arc::new(serde_json::to_vec(&growth.document(asks))?))
            }
            Route::Field => match growth {
                Some(growth) => {
                    let (version, bytes) = growth.bytes();
                    Answer { version: Some(version), ..binary(bytes) }
                }
                None => binary(self.once(route, |subject| Ok(page::field_bytes(subject)))?),
            },
            Route::Points(modality) => binary(self.once(route, |subject| points::read(&subject.dataset, modality))?),
            Route::Keyframe(index) => json(self.once(route, |subject| Ok(serde_json::to_vec(&subject.keyframe(index)?)?))?),
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_routes_of_the_table_lead_anywhere() {
        let of = |target| Route::of(target, 40);
        assert_eq!(of("/"), Some(Route::Page));
        assert_eq!(of("/?x=1"), Some(Route::Page));
        assert_eq!(of("/data/scene"), Some(Route::Scene));
        assert_eq!(of("/data/field"), Some(Route::Field));
        assert_eq!(of("/data/growth"), Some(Route::Growth { asks: true }));
        assert_eq!(of("/data/progress"), Some(Route::Growth { asks: false }));
        assert_eq!(of("/data/points-rf"), Some(Route::Points("rf")));
        assert_eq!(of("/data/keyframe-1"), Some(Route::Keyframe(0)));
        assert_eq!(of("/data/keyframe-40"), Some(Route::Keyframe(39)));
        for none in [
            "",
            "/index.html",
            "/data/",
            "/data/keyframe-0",
            "/data/keyframe-41",
            "/data/keyframe-+1",
            "/data/keyframe-99999999999999999999999",
            "/data/../run.json",
            "/run.json",
            "/%2e%2e/run.json",
            "//etc/passwd",
        ] {
            assert_eq!(of(none), None, "{none}");
        }
    }
}
