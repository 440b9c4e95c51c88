//! Notes about many things that are alike: one sentence for each cause, however many things it concerns.

use std::collections::HashMap;

use lodpack_mesh::images::shown_name;
use lodpack_runtime::text::count;

/// The number of things that are named for each cause. The others are counted.
const MOST_NAMES: usize = 10;

/// Why things were left out, in the order in which each cause was first found.
#[derive(Default)]
pub struct Causes {
    list: Vec<Cause>,
    /// Their numbers, by what tells them apart.
    numbers: HashMap<String, usize>,
}

struct Cause {
    /// About the first thing.
    sentence: String,
    /// The names of the next ones.
    others: Vec<String>,
    /// How many more there are.
    more: u64,
}

impl Causes {
    /// Adds a thing to a cause. `sentence` says what the matter is, given its name as messages show it.
    pub fn add(&mut self, cause: &str, name: &str, sentence: impl FnOnce(&str) -> String) {
        let Some(&number) = self.numbers.get(cause) else {
            self.numbers.insert(cause.to_owned(), self.list.len());
            self.list.push(Cause { sentence: sentence(&shown_name(name)), others: vec![], more: 0 });
            return;
        };
        let cause = &mut self.list[number];
        if cause.others.len() + 1 < MOST_NAMES {
            cause.others.push(shown_name(name));
        } else {
            cause.more += 1;
        }
    }

    /// One sentence for each cause.
    pub fn sentences(&self) -> impl Iterator<Item = String> {
        self.list.iter().map(|Cause { sentence, others, more }| match (others.as_slice(), more) {
            ([], _) => sentence.clone(),
            ([one], 0) => format!("{sentence}; the same is true of {one}"),
            ([names @ .., last], 0) => format!("{sentence}; the same is true of {} and {last}", names.join(", ")),
            (names, more) => format!("{sentence}; the same is true of {} and {} more", names.join(", "), count(*more)),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_cause_has_one_sentence_with_the_first_names() {
        let mut causes = Causes::default();
        let add = |causes: &mut Causes, name: &str| causes.add("gone", name, |name| format!("{name} is gone"));
        let first = |causes: &Causes| causes.sentences().next().unwrap_or_default();
        add(&mut causes, "a\nb");
        assert_eq!(first(&causes), "a b is gone");
        add(&mut causes, "c");
        assert_eq!(first(&causes), "a b is gone; the same is true of c");
        add(&mut causes, "d");
        assert_eq!(first(&causes), "a b is gone; the same is true of c and d");
        (0..2000).for_each(|number| add(&mut causes, &number.to_string()));
        assert_eq!(first(&causes), "a b is gone; the same is true of c, d, 0, 1, 2, 3, 4, 5, 6 and 1,993 more");
        causes.add("grey", "e", |name| format!("{name} is grey"));
        assert_eq!(causes.sentences().nth(1).as_deref(), Some("e is grey"));
    }
}
