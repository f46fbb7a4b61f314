//! Hugging Face's card and the citation.

use super::{Author, Publication};

/// A text as a YAML scalar: JSON's strings are YAML's.
fn scalar(text: &str) -> String {
    serde_json::Value::from(text).to_string()
}

/// A text in BibTeX's braces.
fn braced(text: &str) -> String {
    let escaped: String = text.chars().flat_map(|c| if "{}\\".contains(c) { vec![] } else { vec![c] }).collect();
    format!("{{{escaped}}}")
}

impl Publication<'_> {
    /// Words that it is found by.
    pub(super) fn tags(&self) -> Vec<&'static str> {
        let has = self.dataset.modalities();
        let light: &[&str] = if has.light { &["radiance-field", "gaussian-splatting", "novel-view-synthesis"] } else { &[] };
        let radio: &[&str] = if has.radio { &["radio", "angular-power-spectrum", "radio-radiance-field"] } else { &[] };
        [light, radio].concat()
    }

    /// What a value of a spectrum is.
    pub(super) fn unit(&self) -> String {
        match self.dataset.header() {
            header if header.imported.is_none() => format!("{} for 1 W transmitted", header.quantity.unit()),
            header => match header.quantity.unit() {
                "unknown" => "a unit that its maker did not state".to_owned(),
                unit => unit.to_owned(),
            },
        }
    }

    /// The card.
    pub(super) fn card(&self) -> String {
        let (statement, answers) = (&self.statement, self.answers());
        let sizes = [(1000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K")];
        let size = sizes.into_iter().find(|(most, _)| self.dataset.len() < *most).map_or("100K<n<1M", |(_, name)| name);
        let tags: String = self.tags().iter().map(|tag| format!("- {tag}\n")).collect();
        let files: String =
            self.splits.iter().map(|s| format!("  - split: {}\n    path: data/{}-*.parquet\n", s.name, s.name)).collect();
        // What spectra alone are for has no name there.
        let task = if self.dataset.modalities().light { "image-to-3d" } else { "other" };
        let head = format!(
            "---\nlicense: {}\npretty_name: {}\nsize_categories:\n- {size}\ntask_categories:\n- {task}\ntags:\n{tags}configs:\n- \
             config_name: default\n  data_files:\n{files}---\n",
            statement.licence.id,
            scalar(&statement.title)
        );
        let said = |text: Option<String>| text.unwrap_or_else(|| "Not stated.".to_owned());
        let has = self.dataset.modalities();
        let mut columns = vec![
            ("index, file", "index from 0 along the trajectory; stem of the keyframe's files in `dataset/`".to_owned()),
            ("time_s", "seconds".to_owned()),
            ("split", format!("{}; `is_validation` and `in_held_out_segment` mark further protocols", self.summary())),
            ("world_from_camera", "4 x 4 pose by rows: OpenCV camera axes to a right-handed world, z up, metres".to_owned()),
        ];
        if has.light {
            let camera = self.dataset.light_camera();
            columns.push((
                "image",
                format!(
                    "PNG, sRGB, {} x {}; fx {}, fy {}, cx {}, cy {} pixels, no distortion, pixel centres at +0.5",
                    camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy
                ),
            ));
        }
        if let (true, Some(range)) = (has.radio, self.dataset.db_range()) {
            let camera = self.dataset.radio_camera();
            columns.push((
                "spectrum",
                format!(
                    "{} rows of {} float32: linear power in {}, 0 is an empty bin; pinhole with fx {}, fy {}, cx {}, cy {}",
                    camera.height,
                    camera.width,
                    self.unit(),
                    camera.fx,
                    camera.fy,
                    camera.cx,
                    camera.cy
                ),
            ));
            columns.push(("spectrum_image", format!("PNG, Jet colours of {} to {} dB", range.min_db, range.max_db)));
        }
        let columns: String = columns.into_iter().map(|(name, what)| format!("| `{name}` | {what} |\n")).collect();
        format!(
            "{head}# {title}\n\n{description}\n\n![{pictures}](contact-sheet.png)\n\n```python\nfrom datasets import load_dataset\n\n\
             keyframes = load_dataset(\"PATH OR NAME\", split=\"train\")\n{first}\
             keyframes[0][\"world_from_camera\"]    # 4 x 4\n```\n\n| column | content |\n|---|---|\n{columns}\n`dataset/` is the data set itself{rasters}; \
             `dataset/dataset.json` has every convention in words and the SHA-256 of every file, and \
             the program corf opens the folder. Its hash is `{hash}`.\n\n## How it came to be\n\n{collection}\n\n## Before use\n\n\
             - **Meant for.** {uses}\n- **Limits.** {limitations}\n- **Biases.** {biases}\n- **Persons.** {sensitive}\n- **Impact.** {impact}\n\n\
             ## Licence and citation\n\n{licence}, [{spdx}]({licence_url}).\n\n```bibtex\n{bibtex}\n```\n",
            title = statement.title,
            description = self.description(),
            pictures = match (has.light, has.radio) {
                (true, true) => "Images over spectra",
                (true, false) => "Images",
                (false, _) => "Spectra",
            },
            first = match has.light {
                true => "keyframes[0][\"image\"]                # PIL\n",
                false => "keyframes[0][\"spectrum\"]             # by rows, linear power\n",
            },
            rasters = match (self.dataset.has_depth(), has.radio) {
                (true, true) => ", with depth and other float rasters as OpenEXR",
                (true, false) => ", with depth as OpenEXR",
                (false, true) => ", with spectra as OpenEXR",
                (false, false) => "",
            },
            hash = self.dataset.hash(),
            collection = said(answers.collection),
            uses = said(answers.uses),
            limitations = said(answers.limitations),
            biases = said(answers.biases),
            sensitive = said(answers.sensitive),
            impact = said(answers.impact),
            licence = statement.licence.name,
            spdx = statement.licence.spdx,
            licence_url = statement.licence.url,
            bibtex = self.bibtex(),
        )
    }

    /// The citation, for BibTeX.
    pub(super) fn bibtex(&self) -> String {
        let statement = &self.statement;
        let author = |author: &Author| match author {
            Author::Person { family, given } => format!("{family}, {given}"),
            Author::Entity(name) => braced(name),
        };
        let authors: Vec<String> = statement.authors.iter().map(author).collect();
        let key: String = self.dataset.header().name.chars().filter(|c| c.is_ascii_alphanumeric() || *c == '-').collect();
        let mut entry =
            format!("@misc{{{key},\n  title = {},\n  author = {{{}}}", braced(&statement.title), authors.join(" and "));
        if let Some(date) = &statement.date {
            entry += &format!(",\n  year = {{{}}}", &date[..4]);
        }
        if let Some(url) = &statement.url {
            entry += &format!(",\n  url = {}", braced(url));
        }
        entry + &format!(",\n  version = {}\n}}", braced(&statement.version))
    }

    /// `CITATION.cff`.
    pub(super) fn citation(&self) -> String {
        let statement = &self.statement;
        let author = |author: &Author| match author {
            Author::Person { family, given } => {
                format!("  - family-names: {}\n    given-names: {}\n", scalar(family), scalar(given))
            }
            Author::Entity(name) => format!("  - name: {}\n", scalar(name)),
        };
        let authors: String = statement.authors.iter().map(author).collect();
        let mut text = format!(
            "cff-version: 1.2.0\nmessage: If you use these data, please cite them.\ntype: dataset\ntitle: {}\nauthors:\n{authors}version: {}\n\
             license: {}\n",
            scalar(&statement.title),
            scalar(&statement.version),
            statement.licence.spdx
        );
        if let Some(date) = &statement.date {
            text += &format!("date-released: {date}\n");
        }
        if let Some(url) = &statement.url {
            text += &format!("url: {}\n", scalar(url));
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_of_users_stay_words() {
        assert_eq!(scalar("a: \"b\"\n- c"), "\"a: \\\"b\\\"\\n- c\"");
        assert_eq!(braced("a {b} \\c"), "{a b c}");
    }
}
