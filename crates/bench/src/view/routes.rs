//! What the local server answers: a fixed table of routes. No path of a request reaches the file system.

use super::page;
use super::points;
use super::scene::SceneDocument;
use super::subject::Subject;
use anyhow::Result;

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

/// Whether a request's `Host` is this server by its own name: a page of another name that resolves to this machine is not answered (DNS
/// rebinding).
pub(super) fn is_own_host(host: Option<&str>, port: u16) -> bool {
    let own = |name: &str| host == Some(format!("{name}:{port}").as_str()) || (port == 80 && host == Some(name));
    own("127.0.0.1") || own("localhost")
}

/// An answer.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Answer {
    /// Status of HTTP.
    pub status: u16,
    /// Media type.
    pub kind: &'static str,
    /// Content.
    pub body: Vec<u8>,
    /// Version of the content, where there are several.
    pub version: Option<u64>,
}

impl Answer {
    fn of(kind: &'static str, body: Vec<u8>) -> Self {
        Self { status: 200, kind, body, version: None }
    }

    fn text(status: u16, text: &str) -> Self {
        Self { status, ..Self::of("text/plain; charset=utf-8", format!("{text}\n").into_bytes()) }
    }
}

/// Answers a request; what goes wrong inside is an answer too.
pub(super) fn answer(subject: &mut Subject, port: u16, method: &str, target: &str, host: Option<&str>) -> Answer {
    if !is_own_host(host, port) {
        return Answer::text(403, &format!("this server answers to http://127.0.0.1:{port}/ only"));
    }
    if method != "GET" && method != "HEAD" {
        return Answer::text(405, "this server is only read");
    }
    let route = Route::of(target, subject.dataset.len());
    let answered = route.map_or(Ok(None), |route| content(subject, route));
    match answered {
        Ok(answer) => answer.unwrap_or_else(|| Answer::text(404, "there is nothing here")),
        Err(error) => Answer::text(500, &format!("{error:#}")),
    }
}

/// The content of a route; none where the subject has no such thing.
fn content(subject: &mut Subject, route: Route) -> Result<Option<Answer>> {
    let json = |body: Vec<u8>| Answer::of("application/json", body);
    let binary = |body: Vec<u8>| Answer::of("application/octet-stream", body);
    let growth = subject.work.as_ref().map(|work| &work.growth);
    Ok(Some(match route {
        Route::Page => Answer::of("text/html; charset=utf-8", page::served(&SceneDocument::of(subject)?).into_bytes()),
        Route::Scene => json(serde_json::to_vec(&SceneDocument::of(subject)?)?),
        Route::Growth { asks } => {
            let Some(growth) = growth else { return Ok(None) };
            json(serde_json::to_vec(&growth.document(asks))?)
        }
        Route::Field => match growth.map(|growth| growth.bytes()) {
            Some((version, bytes)) => Answer { version: Some(version), ..binary(bytes) },
            None => binary(page::field_bytes(subject)),
        },
        Route::Points(modality) => binary(points::read(&subject.dataset, modality)?),
        Route::Keyframe(index) => json(serde_json::to_vec(&subject.keyframe(index)?)?),
    }))
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

    #[test]
    fn only_its_own_names_are_answered_to() {
        for own in ["127.0.0.1:8123", "localhost:8123"] {
            assert!(is_own_host(Some(own), 8123), "{own}");
        }
        for other in [
            None,
            Some(""),
            Some("127.0.0.1"),
            Some("localhost"),
            Some("127.0.0.1:80"),
            Some("evil.example:8123"),
            Some("127.0.0.1:8123.evil.example"),
        ] {
            assert!(!is_own_host(other, 8123), "{other:?}");
        }
        assert!(is_own_host(Some("localhost"), 80));
    }
}
