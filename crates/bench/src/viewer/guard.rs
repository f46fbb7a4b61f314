//! Who is answered: requests that read, come from the page itself or from its address, and know the token that the address carries.

use anyhow::{Result, anyhow};
use std::fmt::{Display, Formatter, Write};

/// Random bytes of a token: 128 bits, which nobody guesses.
const TOKEN_BYTES: usize = 16;
/// Characters of a token.
const TOKEN_DIGITS: usize = 2 * TOKEN_BYTES;
/// Time after its last use when a browser forgets a token, seconds: a day. Cookies of an address go to all servers on it, whatever the port.
const COOKIE_AGE_S: u32 = 86_400;

/// The secret of one server: who knows it may look. It is printed with the address, and nowhere else.
pub struct Token(String);

impl Token {
    /// A token that nobody knows, from the system's source of randomness.
    ///
    /// # Errors
    /// A system without such a source.
    pub fn draw() -> Result<Self> {
        let mut bytes = [0; TOKEN_BYTES];
        getrandom::fill(&mut bytes).map_err(|error| anyhow!("the system gives no random bytes for the page's token: {error}"))?;
        Ok(Self::of(bytes))
    }

    /// The token of 128 bits.
    pub fn of(bytes: [u8; TOKEN_BYTES]) -> Self {
        let mut text = String::with_capacity(TOKEN_DIGITS);
        bytes.iter().for_each(|byte| write!(text, "{byte:02x}").unwrap_or_default());
        Self(text)
    }

    /// Whether a text is this token. The time it takes depends on the text's length alone, so that it cannot be felt for digit by digit.
    fn is(&self, text: &[u8]) -> bool {
        let differs = self.0.bytes().zip(text).fold(0, |sum, (a, b)| sum | (a ^ b));
        std::hint::black_box(differs) == 0 && text.len() == TOKEN_DIGITS
    }
}

impl Display for Token {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

/// Why a request is not answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// Its target is no path of this server, as a request to a proxy has.
    Target,
    /// It asks another name: a name that somebody else has led to this machine (DNS rebinding).
    Host,
    /// Another site's page asks.
    Site,
    /// It is no GET and no HEAD.
    Method,
    /// It brings a body.
    Body,
    /// It knows no token, or a wrong one.
    Token,
}

impl Refusal {
    /// Status of HTTP.
    pub fn status(self) -> u16 {
        match self {
            Self::Target => 400,
            Self::Host | Self::Site | Self::Token => 403,
            Self::Method => 405,
            Self::Body => 413,
        }
    }

    /// What is wrong, and what to do.
    pub fn words(self, port: u16) -> String {
        match self {
            Self::Target => "this server is no proxy: a request names a path that begins with /".to_owned(),
            Self::Host => format!("this server answers to http://127.0.0.1:{port}/ only: open the address that corf has printed"),
            Self::Site => {
                "this server does not answer to pages of other sites: open the address that corf has printed".to_owned()
            }
            Self::Method => "this server is only read: GET and HEAD are what it answers to".to_owned(),
            Self::Body => "this server takes nothing in: a request has no body".to_owned(),
            Self::Token => format!(
                "This page opens to whoever has its token. Open the whole address that corf has printed, http://127.0.0.1:{port}/?token=… with \
                 what follows. The token is another one each time that corf is started: an address of before does not open it."
            ),
        }
    }
}

/// A request, as far as it decides whether it is answered.
#[derive(Clone, Copy, Debug)]
pub struct Asked<'r> {
    /// Its method.
    pub method: &'r str,
    /// Its target as it was sent: path and query.
    pub target: &'r str,
    /// Names and values of its headers, in order.
    pub headers: &'r [(&'r str, &'r [u8])],
}

impl<'r> Asked<'r> {
    fn all(&self, name: &'static str) -> impl Iterator<Item = &'r [u8]> + use<'r> {
        self.headers.iter().filter(move |(n, _)| n.eq_ignore_ascii_case(name)).map(|(_, value)| *value)
    }

    /// The one value of a header; an empty one, which no check takes, where there are several.
    fn one(&self, name: &'static str) -> Option<&'r [u8]> {
        let mut all = self.all(name);
        let first = all.next()?;
        Some(if all.next().is_some() { b"" } else { first })
    }

    fn has_body(&self) -> bool {
        self.all("transfer-encoding").next().is_some() || self.all("content-length").any(|value| value != b"0")
    }
}

/// The first value of a key in the query of a target, as it was sent.
fn of_query<'t>(target: &'t str, key: &str) -> Option<&'t str> {
    let query = target.split_once('?')?.1.split('#').next()?;
    query.split('&').find_map(|pair| pair.strip_prefix(key)?.strip_prefix('='))
}

/// What decides whether a request is answered.
pub struct Guard {
    port: u16,
    token: Token,
}

impl Guard {
    /// The guard of a server on a port of this machine.
    pub fn new(port: u16, token: Token) -> Self {
        Self { port, token }
    }

    /// The port of the server.
    pub fn port(&self) -> u16 {
        self.port
    }

    /// The address that opens the page.
    pub fn url(&self) -> String {
        format!("http://127.0.0.1:{}/?token={}", self.port, self.token)
    }

    /// Name of the cookie that keeps the token: the port is in it, so that several viewers do not overwrite each other's.
    fn cookie_name(&self) -> String {
        format!("corf-view-{}", self.port)
    }

    /// What makes a browser keep the token for requests of the page itself.
    pub fn cookie(&self) -> String {
        format!("{}={}; HttpOnly; SameSite=Strict; Path=/; Max-Age={COOKIE_AGE_S}", self.cookie_name(), self.token)
    }

    /// Whether `host` is this machine, at this port.
    fn is_own(&self, host: &[u8]) -> bool {
        let port = self.port;
        ["127.0.0.1", "localhost", "[::1]"].iter().any(|name| {
            host.eq_ignore_ascii_case(format!("{name}:{port}").as_bytes())
                || (port == 80 && host.eq_ignore_ascii_case(name.as_bytes()))
        })
    }

    /// Whether the token is in the query or, where the query has none, in a cookie.
    fn knows_token(&self, asked: &Asked<'_>) -> bool {
        if let Some(token) = of_query(asked.target, "token") {
            return self.token.is(token.as_bytes());
        }
        let name = self.cookie_name();
        let is_it = |cookie: &[u8]| {
            let cookie = cookie.trim_ascii();
            cookie
                .strip_prefix(name.as_bytes())
                .and_then(|rest| rest.strip_prefix(b"="))
                .is_some_and(|value| self.token.is(value))
        };
        asked.all("cookie").flat_map(|line| line.split(|byte| *byte == b';')).any(is_it)
    }

    /// Whether a page of another site asks. A link of another site may open the page, but for that it must know the address.
    fn is_of_other_site(&self, asked: &Asked<'_>) -> bool {
        let other_origin =
            asked.one("origin").is_some_and(|origin| !origin.strip_prefix(b"http://").is_some_and(|host| self.is_own(host)));
        let opens = asked.one("sec-fetch-mode") == Some(b"navigate")
            && asked.one("sec-fetch-dest") == Some(b"document")
            && asked.target.split('?').next() == Some("/");
        let fetches = asked.one("sec-fetch-site").is_some_and(|site| site != b"same-origin" && site != b"none");
        other_origin || (fetches && !opens)
    }

    /// Lets a request pass, or says why not.
    ///
    /// # Errors
    /// The first reason against it.
    pub fn check(&self, asked: &Asked<'_>) -> Result<(), Refusal> {
        let must = |is: bool, refusal: Refusal| if is { Ok(()) } else { Err(refusal) };
        must(asked.method == "GET" || asked.method == "HEAD", Refusal::Method)?;
        must(!asked.has_body(), Refusal::Body)?;
        must(asked.target.starts_with('/'), Refusal::Target)?;
        must(asked.one("host").is_some_and(|host| self.is_own(host)), Refusal::Host)?;
        must(!self.is_of_other_site(asked), Refusal::Site)?;
        must(self.knows_token(asked), Refusal::Token)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PORT: u16 = 8123;

    fn guard() -> Guard {
        Guard::new(PORT, Token::of(*b"sixteen letters!"))
    }

    fn token() -> String {
        Token::of(*b"sixteen letters!").to_string()
    }

    /// The answer to a request that is right but for what is given.
    fn check(method: &str, target: &str, headers: &[(&str, &str)]) -> Result<(), Refusal> {
        let headers: Vec<(&str, &[u8])> = headers.iter().map(|(name, value)| (*name, value.as_bytes())).collect();
        guard().check(&Asked { method, target, headers: &headers })
    }

    fn own() -> (&'static str, &'static str) {
        ("Host", "127.0.0.1:8123")
    }

    #[test]
    fn a_token_is_of_128_bits_of_the_system_and_of_no_other_text() {
        let (a, b) = (Token::draw().unwrap(), Token::draw().unwrap());
        assert!(a.0.len() == 32 && a.0.bytes().all(|byte| byte.is_ascii_hexdigit()) && a.0 != b.0);
        assert!(a.is(a.to_string().as_bytes()) && !a.is(b.0.as_bytes()));
        for n in 0..TOKEN_DIGITS {
            assert!(!a.is(&a.0.as_bytes()[..n]), "the first {n} digits");
            let mut other = a.0.clone().into_bytes();
            other[n] ^= 1;
            assert!(!a.is(&other), "digit {n} is another");
        }
        assert!(!a.is(format!("{a}0").as_bytes()));
    }

    #[test]
    fn the_token_opens_by_query_and_by_cookie() {
        let (token, wrong) = (token(), Token::of(*b"sixteen letters?").to_string());
        let name = format!("corf-view-{PORT}");
        let by_query = |query: &str| check("GET", &format!("/data/scene{query}"), &[own()]);
        assert_eq!(by_query(&format!("?token={token}")), Ok(()));
        assert_eq!(by_query(&format!("?a=1&token={token}&b")), Ok(()));
        for query in
            ["", "?", "?token", "?token=", &format!("?token={wrong}"), &format!("?xtoken={token}"), &format!("?token={token}0")]
        {
            assert_eq!(by_query(query), Err(Refusal::Token), "{query}");
        }
        let by_cookie = |cookie: &str| check("HEAD", "/data/scene", &[own(), ("cookie", cookie)]);
        assert_eq!(by_cookie(&format!("{name}={token}")), Ok(()));
        assert_eq!(by_cookie(&format!("a=b; {name}={wrong};{name}={token} ; c")), Ok(()));
        for cookie in [format!("corf-view-8124={token}"), format!("x{name}={token}"), format!("{name}={wrong}"), token.clone()] {
            assert_eq!(by_cookie(&cookie), Err(Refusal::Token), "{cookie}");
        }
        // A token that is given must be right, whatever the browser remembers.
        let both = [own(), ("cookie", &*format!("{name}={token}"))];
        assert_eq!(check("GET", &format!("/?token={wrong}"), &both), Err(Refusal::Token));
        assert!(guard().cookie().starts_with(&format!("{name}={token}; HttpOnly; SameSite=Strict")));
        assert_eq!(guard().url(), format!("http://127.0.0.1:8123/?token={token}"));
    }

    #[test]
    fn only_its_own_names_are_answered_to() {
        let target = format!("/?token={}", token());
        let of = |host: &str| check("GET", &target, &[("host", host)]);
        for host in ["127.0.0.1:8123", "localhost:8123", "LocalHost:8123", "[::1]:8123"] {
            assert_eq!(of(host), Ok(()), "{host}");
        }
        let others =
            ["", "127.0.0.1", "localhost", "127.0.0.1:80", "127.0.0.1:81230", "evil.example:8123", "127.0.0.1:8123.evil.example"];
        for host in others {
            assert_eq!(of(host), Err(Refusal::Host), "{host}");
        }
        assert_eq!(check("GET", &target, &[]), Err(Refusal::Host));
        assert_eq!(check("GET", &target, &[own(), own()]), Err(Refusal::Host), "which of the two?");
        assert!(Guard::new(80, Token::of([0; 16])).is_own(b"localhost"));
    }

    #[test]
    fn other_sites_fetch_nothing_and_may_open_the_page_by_its_address() {
        let with =
            |path: &str, more: &[(&str, &str)]| check("GET", &format!("{path}?token={}", token()), &[&[own()], more].concat());
        for site in ["same-origin", "none"] {
            assert_eq!(with("/data/scene", &[("Sec-Fetch-Site", site)]), Ok(()), "{site}");
        }
        let opens = [("sec-fetch-mode", "navigate"), ("sec-fetch-dest", "document")];
        for site in ["same-site", "cross-site", "", "else"] {
            let fetches = ("sec-fetch-site", site);
            assert_eq!(with("/data/scene", &[fetches]), Err(Refusal::Site), "{site}");
            assert_eq!(with("/", &[fetches]), Err(Refusal::Site), "{site}");
            assert_eq!(with("/", &[fetches, opens[0], ("sec-fetch-dest", "iframe")]), Err(Refusal::Site), "{site}");
            assert_eq!(with("/data/scene", &[fetches, opens[0], opens[1]]), Err(Refusal::Site), "{site}");
            assert_eq!(with("/", &[fetches, opens[0], opens[1]]), Ok(()), "{site}");
        }
        for origin in ["http://127.0.0.1:8123", "http://localhost:8123"] {
            assert_eq!(with("/data/scene", &[("origin", origin)]), Ok(()), "{origin}");
        }
        for origin in ["null", "", "https://127.0.0.1:8123", "http://127.0.0.1:8124", "http://evil.example", "127.0.0.1:8123"] {
            assert_eq!(with("/data/scene", &[("origin", origin)]), Err(Refusal::Site), "{origin}");
        }
    }

    #[test]
    fn it_is_only_read() {
        let target = format!("/?token={}", token());
        for method in ["POST", "PUT", "DELETE", "OPTIONS", "CONNECT", "TRACE", "get", ""] {
            assert_eq!(check(method, &target, &[own()]), Err(Refusal::Method), "{method}");
        }
        for body in
            [("Content-Length", "5"), ("content-length", "many"), ("transfer-encoding", "chunked"), ("Transfer-Encoding", "")]
        {
            assert_eq!(check("GET", &target, &[own(), body]), Err(Refusal::Body), "{body:?}");
        }
        assert_eq!(check("GET", &target, &[own(), ("content-length", "0")]), Ok(()));
        for target in ["*", "", "http://127.0.0.1:8123/", "127.0.0.1:8123"] {
            assert_eq!(check("GET", target, &[own()]), Err(Refusal::Target), "{target}");
        }
    }
}
