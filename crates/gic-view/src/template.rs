//! Pages from templates: text in the templates, numbers and names in their context.

use minijinja::syntax::SyntaxConfig;
use minijinja::value::{Serde, Value};
use minijinja::{AutoEscape, Environment, UndefinedBehavior};
use serde::Serialize;

use crate::error::{Result, ViewError};

/// A template: its name, by which others include it, and its text.
pub type Template = (&'static str, &'static str);

/// Fills in the first of some templates, which may include the others. Values are escaped for HTML unless the template
/// marks them as safe.
///
/// # Errors
/// A template that is not valid, or one that asks for what the context does not have.
pub fn fill(templates: &[Template], context: &impl Serialize) -> Result<String> {
    let mut environment = Environment::new();
    environment.set_auto_escape_callback(|_| AutoEscape::Html);
    environment.set_undefined_behavior(UndefinedBehavior::Strict);
    let failed = ViewError::stage::<minijinja::Error>;
    // Lines that hold nothing but a tag of the template leave nothing in the page.
    let syntax = SyntaxConfig::builder().trim_blocks(true).lstrip_blocks(true).build();
    environment.set_syntax(syntax.map_err(failed("reading a template"))?);
    for (name, text) in templates {
        environment.add_template(name, text).map_err(failed("reading a template"))?;
    }
    let first = templates.first().map_or("", |(name, _)| *name);
    environment
        .get_template(first)
        .and_then(|page| page.render(Value::from(Serde(context))))
        .map_err(failed("filling in a page"))
}

/// A value as JSON that a script element may hold: no tag in a text can end the element.
///
/// # Errors
/// A number that is not finite.
pub fn script_json(value: &impl Serialize) -> Result<String> {
    let text = gic_twin::json::text(value).map_err(ViewError::stage("writing a page"))?;
    Ok(text.replace('<', "\\u003c"))
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn names_cannot_become_markup() {
        let page = fill(&[("a", "<p>{{ name }}</p>{% include 'b' %}"), ("b", "{{ name }}")], &json!({"name": "<b>&"}));
        assert_eq!(page.unwrap(), "<p>&lt;b&gt;&amp;</p>&lt;b&gt;&amp;");
        assert!(!script_json(&json!({"name": "</script>"})).unwrap().contains("</"));
    }

    #[test]
    fn what_the_context_does_not_have_is_an_error() {
        assert!(fill(&[("a", "{{ missing }}")], &json!({})).is_err());
    }
}
