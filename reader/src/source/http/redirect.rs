//! Where redirects lead (RFC 9110, 10.2.2).

use ureq::http::Uri;

/// The address that a `Location` means at an address. What is no address fails when it is asked for.
pub fn resolved(from: &str, to: &str) -> String {
    let to = to.split('#').next().unwrap_or_default();
    if to.split(['/', '?']).next().is_some_and(|start| start.ends_with(':')) {
        return to.to_owned();
    }
    let Some((scheme, rest)) = from.split_once("://") else { return to.to_owned() };
    if to.starts_with("//") {
        return format!("{scheme}:{to}");
    }
    let path_start = rest.find(['/', '?', '#']).unwrap_or(rest.len());
    let (host, path) = rest.split_at(path_start);
    if to.starts_with('/') {
        return format!("{scheme}://{host}{to}");
    }
    let path = path.split(['?', '#']).next().unwrap_or_default();
    let folder = path.rfind('/').map_or("/", |end| &path[..=end]);
    format!("{scheme}://{host}{folder}{to}")
}

/// Whether both addresses are of one host, and the second one is no less secret than the first.
pub fn is_same_host(from: &str, to: &str) -> bool {
    let parts = |address: &str| {
        let address: Uri = address.parse().ok()?;
        Some((address.host()?.to_ascii_lowercase(), address.scheme_str()?.to_ascii_lowercase()))
    };
    match (parts(from), parts(to)) {
        (Some((host, scheme)), Some((other, other_scheme))) => {
            host == other && (scheme == other_scheme || other_scheme == "https")
        }
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn locations_are_relative_to_where_they_were_said() {
        let from = "http://host:80/a/b.lodpack?x=1/2";
        for (to, expected) in [
            ("https://else/x#y", "https://else/x"),
            ("//else/x", "http://else/x"),
            ("/x?y", "http://host:80/x?y"),
            ("c", "http://host:80/a/c"),
            ("c:d/e", "http://host:80/a/c:d/e"),
        ] {
            assert_eq!(resolved(from, to), expected);
        }
        assert_eq!(resolved("http://host", "c"), "http://host/c");
        assert!(is_same_host(from, "https://HOST/x") && is_same_host(from, "http://host:81/x"));
        assert!(!is_same_host(from, "http://host.else/x") && !is_same_host("https://host/", "http://host/"));
        assert!(!is_same_host(from, "file:///etc/passwd") && !is_same_host(from, "http://host@else/"));
    }
}
