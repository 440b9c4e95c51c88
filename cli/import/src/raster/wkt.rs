//! Well-known text of coordinate reference systems, as a tree: WKT 1 of GDAL and of ESRI, and WKT 2. What the words
//! mean stands in `crs`.

/// The longest text: what a file may keep of it (SPEC.md, 6.5).
pub(super) const MAX_BYTES: usize = 1 << 16;
/// Words within words. Those of a compound system with bounds are nine deep.
const MAX_DEPTH: usize = 32;

/// A word with what its brackets hold.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Node<'a> {
    /// Without a case of its own: some programs write small letters.
    pub word: String,
    /// Texts without their quotes, numbers, and words without brackets, in their order.
    pub values: Vec<&'a str>,
    /// Words with brackets, in their order.
    pub nodes: Vec<Node<'a>>,
}

impl<'a> Node<'a> {
    /// The first part with one of these words.
    pub fn part(&self, words: &[&str]) -> Option<&Node<'a>> {
        self.nodes.iter().find(|node| words.contains(&node.word.as_str()))
    }

    /// The value at a place as a number.
    pub fn number(&self, at: usize) -> Option<f64> {
        self.values.get(at)?.parse().ok()
    }

    /// The name, which is the first value.
    pub fn name(&self) -> &'a str {
        self.values.first().copied().unwrap_or_default()
    }
}

/// Reads words that follow each other: ESRI has one for the place and one for the heights.
///
/// # Errors
/// What is wrong, and at which byte.
pub(super) fn parse(text: &str) -> Result<Vec<Node<'_>>, String> {
    if text.len() > MAX_BYTES {
        return Err(format!("it has {} bytes, and at most {MAX_BYTES} can be read", text.len()));
    }
    // Words that are still open, behind one that holds all of them.
    let mut open = vec![Node::default()];
    let mut at = 0;
    while let Some(first) = text[at..].chars().next() {
        let rest = &text[at..];
        let last = open.len() - 1;
        match first {
            '"' => {
                // A quote within a text is written twice.
                let mut end = 1;
                loop {
                    end += rest[end..].find('"').ok_or_else(|| format!("the quotes at byte {at} do not end"))? + 1;
                    if !rest[end..].starts_with('"') {
                        break;
                    }
                    end += 1;
                }
                open[last].values.push(&rest[1..end - 1]);
                at += end;
            }
            ']' | ')' => {
                let Some(node) = open.pop_if(|_| last > 0) else {
                    return Err(format!("the bracket at byte {at} closes nothing"));
                };
                open[last - 1].nodes.push(node);
                at += 1;
            }
            _ if first == ',' || first.is_whitespace() => at += first.len_utf8(),
            '[' | '(' => return Err(format!("the bracket at byte {at} has no word before it")),
            _ => {
                let end = rest.find(|c: char| "[](),\"".contains(c) || c.is_whitespace()).unwrap_or(rest.len());
                let word = &rest[..end];
                let behind = rest[end..].trim_start();
                if !behind.starts_with(['[', '(']) {
                    open[last].values.push(word);
                    at += end;
                    continue;
                }
                if open.len() > MAX_DEPTH {
                    return Err(format!("its brackets are more than {MAX_DEPTH} deep at byte {at}"));
                }
                open.push(Node { word: word.to_ascii_uppercase(), ..Node::default() });
                at += rest.len() - behind.len() + 1;
            }
        }
    }
    let inner = open.split_off(1);
    let all = open.swap_remove(0);
    match inner.last() {
        Some(node) => Err(format!("{} brackets are open at its end, the last one of {}", inner.len(), node.word)),
        None if all.nodes.is_empty() || !all.values.is_empty() => Err("it is no well-known text".into()),
        None => Ok(all.nodes),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn brackets_quotes_and_space_of_all_dialects_are_read() {
        let text = "PROJCS [\"a \"\"b\"\", (c]\" , Geogcs(\"g\",north , UNIT[\"m\", 1.5]) ],VERTCS[\"v\"]";
        let roots = parse(text).expect("sound");
        assert_eq!(roots.iter().map(|node| node.word.as_str()).collect::<Vec<_>>(), ["PROJCS", "VERTCS"]);
        assert_eq!(roots[0].name(), "a \"\"b\"\", (c]");
        let inner = roots[0].part(&["GEOGCS"]).expect("there");
        assert_eq!((&inner.values[..], inner.nodes[0].number(1)), (&["g", "north"][..], Some(1.5)));
    }

    #[test]
    fn text_that_is_no_tree_is_refused_wherever_it_is_cut() {
        let whole = "COMPD_CS[\"x\",GEOGCS[\"g\",UNIT[\"degree\",0.01]],VERT_CS[\"v\"]]";
        assert!((0..whole.len()).all(|end| parse(&whole[..end]).is_err()));
        assert!(parse(whole).is_ok());
        for (text, says) in [
            ("A[\"x\"]]".to_owned(), "closes nothing"),
            ("A[[1]]".to_owned(), "no word"),
            ("A[\"x]".to_owned(), "do not end"),
            ("+proj=utm".to_owned(), "no well-known text"),
            ("A[\"ä\",B[".to_owned(), "2 brackets"),
            ("A[".repeat(100), "deep"),
            ("A[".repeat(100_000), "at most 65536"),
            (format!("A[\"{}\"]", "x".repeat(1 << 20)), "at most 65536"),
        ] {
            let error = parse(&text).expect_err("damaged");
            assert!(error.contains(says), "{error}");
        }
    }
}
