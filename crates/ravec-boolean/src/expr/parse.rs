//! Expressions as people write them.
//!
//! Names, `|`, `&`, `-`, `^` and parentheses. `&` binds most tightly; `|`, `-` and `^` bind equally and are worked off from left
//! to right, as a product is worked off before a sum: `a | b - c & d` is `(a | b) - (c & d)`.
//!
//! A name is letters, digits and underscores. Guarantees: any text gives an expression or an error with its place, with
//! bounded recursion. Cost: linear in the text.

use super::Expr;

/// More levels than this are refused: nobody writes them, and recursion over them would need ever more stack.
const MAX_DEPTH: usize = 200;

/// Why a text is not an expression. Places are bytes from its beginning.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ParseExprError {
    /// A mesh should stand there.
    #[error("expected the name of a mesh or an opening parenthesis{}, {}", after.as_deref().map_or(String::new(), |after| format!(" after `{after}`")), found.as_ref().map_or_else(|| "but the expression ends".to_owned(), |found| format!("found `{found}`")))]
    NoOperand {
        /// Position in bytes.
        at: usize,
        /// Text found instead; empty at the end.
        found: Option<String>,
        /// The operator or parenthesis before it.
        after: Option<String>,
    },
    /// Two meshes stand side by side.
    #[error("expected one of the operators | & - ^ before `{found}`")]
    NoOperator {
        /// Position in bytes.
        at: usize,
        /// Text found instead.
        found: String,
    },
    /// A parenthesis opens and is not closed.
    #[error("this parenthesis is not closed")]
    NotClosed {
        /// Position in bytes of the opening.
        at: usize,
    },
    /// A parenthesis closes that was not opened.
    #[error("this closing parenthesis has no opening one")]
    NotOpened {
        /// Position in bytes.
        at: usize,
    },
    /// A character that no expression contains.
    #[error("unexpected `{found}`: names are letters, digits and underscores, operators | & - ^")]
    Stray {
        /// Position in bytes.
        at: usize,
        /// The character.
        found: char,
    },
    /// A name that is not among those that were given.
    #[error("there is no mesh named `{name}`{}", if known.is_empty() { String::new() } else { format!(" (there {} {})", if known.len() == 1 { "is" } else { "are" }, known.join(", ")) })]
    UnknownName {
        /// Position in bytes.
        at: usize,
        /// The name.
        name: String,
        /// The names that there are.
        known: Vec<String>,
    },
    /// Parentheses, or operators that take turns, go too deep.
    #[error(
        "the expression is nested more than {MAX_DEPTH} levels deep: simplify it, or combine the meshes in steps"
    )]
    TooDeep {
        /// Position in bytes.
        at: usize,
    },
}

impl ParseExprError {
    /// Position of the error in bytes from the beginning of the text; its length if something is missing at its end.
    pub fn at(&self) -> usize {
        match self {
            Self::NoOperand { at, .. }
            | Self::NoOperator { at, .. }
            | Self::NotClosed { at }
            | Self::NotOpened { at }
            | Self::Stray { at, .. }
            | Self::UnknownName { at, .. }
            | Self::TooDeep { at } => *at,
        }
    }

    /// The text with a caret under the place of the error, as two lines without a line break at the end.
    ///
    /// ```
    /// let error = ravec_boolean::Expr::parse("a | (b - )").unwrap_err();
    /// assert_eq!(error.to_string(), "expected the name of a mesh or an opening parenthesis after `-`, found `)`");
    /// assert_eq!(error.caret("a | (b - )"), "a | (b - )\n         ^");
    /// ```
    pub fn caret(&self, text: &str) -> String {
        let before = text.char_indices().take_while(|(at, _)| *at < self.at());
        // a line break or tab in the text would move the caret away from its place
        let line: String = text
            .chars()
            .map(|c| if c.is_control() { ' ' } else { c })
            .collect();
        format!("{line}\n{:>1$}", '^', before.count() + 1)
    }
}

impl Expr {
    /// Reads an expression, with the names that it speaks of: mesh 0 is the first of them, and so on in the order in which
    /// they first appear.
    ///
    /// Names are letters, digits and underscores. `&` binds more tightly than `|`, `-` and `^`, which are worked off from left to
    /// right: `a | b - c & d` is `(a | b) - (c & d)`.
    ///
    /// # Errors
    /// All variants of [`ParseExprError`] but [`ParseExprError::UnknownName`].
    pub fn parse(text: &str) -> Result<(Self, Vec<String>), ParseExprError> {
        let mut names: Vec<String> = Vec::new();
        let expr = parse(text, &mut |name, _| {
            let found = names.iter().position(|known| known == name);
            Ok(found.unwrap_or_else(|| {
                names.push(name.to_owned());
                names.len() - 1
            }))
        })?;
        Ok((expr, names))
    }

    /// Reads an expression as [`Self::parse`] does, where mesh `i` has the name `names[i]`.
    ///
    /// # Errors
    /// All variants of [`ParseExprError`].
    pub fn parse_with(text: &str, names: &[impl AsRef<str>]) -> Result<Self, ParseExprError> {
        parse(text, &mut |name, at| {
            let found = names.iter().position(|known| known.as_ref() == name);
            found.ok_or_else(|| ParseExprError::UnknownName {
                at,
                name: name.to_owned(),
                known: names
                    .iter()
                    .map(|known| known.as_ref().to_owned())
                    .collect(),
            })
        })
    }
}

/// The mesh of a name, which stands at a place.
type Resolve<'a> = dyn FnMut(&str, usize) -> Result<usize, ParseExprError> + 'a;

fn parse(text: &str, resolve: &mut Resolve<'_>) -> Result<Expr, ParseExprError> {
    let mut parser = Parser {
        text,
        at: 0,
        last: None,
        resolve,
    };
    let (expr, _) = parser.sum(0)?;
    match parser.peek() {
        None => Ok(expr),
        Some(')') => Err(ParseExprError::NotOpened { at: parser.at }),
        Some(found) => Err(parser.no_operator(found)),
    }
}

struct Parser<'a, 'b> {
    text: &'a str,
    at: usize,
    /// The operator or parenthesis that was read last, while no mesh has followed.
    last: Option<char>,
    resolve: &'a mut Resolve<'b>,
}

/// An expression and its depth.
type Leveled = (Expr, usize);

impl Parser<'_, '_> {
    /// The next character that is not blank, which is not taken.
    fn peek(&mut self) -> Option<char> {
        let rest = &self.text[self.at..];
        let blank = rest.len() - rest.trim_start().len();
        self.at += blank;
        self.text[self.at..].chars().next()
    }

    fn take(&mut self, c: char) {
        self.at += c.len_utf8();
        self.last = Some(c);
    }

    /// Terms of `|`, `-` and `^`, from left to right.
    fn sum(&mut self, open: usize) -> Result<Leveled, ParseExprError> {
        let mut sum = self.product(open)?;
        while let Some(operator @ ('|' | '-' | '^')) = self.peek() {
            let at = self.at;
            self.take(operator);
            let term = self.product(open)?;
            sum = joined(operator, sum, term, at)?;
        }
        Ok(sum)
    }

    /// Terms of `&`.
    fn product(&mut self, open: usize) -> Result<Leveled, ParseExprError> {
        let mut product = self.operand(open)?;
        while self.peek() == Some('&') {
            let at = self.at;
            self.take('&');
            let term = self.operand(open)?;
            product = joined('&', product, term, at)?;
        }
        Ok(product)
    }

    fn operand(&mut self, open: usize) -> Result<Leveled, ParseExprError> {
        match self.peek() {
            Some('(') => {
                let at = self.at;
                if open == MAX_DEPTH {
                    return Err(ParseExprError::TooDeep { at });
                }
                self.take('(');
                let inner = self.sum(open + 1)?;
                match self.peek() {
                    Some(')') => {
                        self.take(')');
                        self.last = None;
                        Ok(inner)
                    }
                    None => Err(ParseExprError::NotClosed { at }),
                    Some(found) => Err(self.no_operator(found)),
                }
            }
            Some(c) if is_of_name(c) => {
                let at = self.at;
                let name = self.word();
                self.at += name.len();
                self.last = None;
                Ok((Expr::Mesh((self.resolve)(&name, at)?), 1))
            }
            found => {
                if let Some(found) = found.filter(|&c| !is_of_expression(c)) {
                    return Err(ParseExprError::Stray { at: self.at, found });
                }
                Err(ParseExprError::NoOperand {
                    at: self.at,
                    found: found.map(String::from),
                    after: self.last.map(String::from),
                })
            }
        }
    }

    /// The letters, digits and underscores that follow.
    fn word(&self) -> String {
        let rest = self.text[self.at..].chars();
        rest.take_while(|&c| is_of_name(c)).collect()
    }

    /// The error for something that stands where an operator should.
    fn no_operator(&self, found: char) -> ParseExprError {
        let at = self.at;
        if !is_of_expression(found) {
            return ParseExprError::Stray { at, found };
        }
        let found = if is_of_name(found) {
            self.word()
        } else {
            found.to_string()
        };
        ParseExprError::NoOperator { at, found }
    }
}

fn is_of_name(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

fn is_of_expression(c: char) -> bool {
    is_of_name(c) || "|&-^()".contains(c)
}

/// Two terms under an operator; further terms of the same operator come under the same node.
fn joined(
    operator: char,
    (left, left_depth): Leveled,
    (right, right_depth): Leveled,
    at: usize,
) -> Result<Leveled, ParseExprError> {
    // A chain of one operator stays one node, however long.
    let chained = matches!(
        (operator, &left),
        ('|', Expr::Union(_))
            | ('&', Expr::Intersection(_))
            | ('-', Expr::Difference(_))
            | ('^', Expr::SymmetricDifference(_))
    );
    let (mut terms, left_depth) = match left {
        Expr::Union(terms)
        | Expr::Intersection(terms)
        | Expr::Difference(terms)
        | Expr::SymmetricDifference(terms)
            if chained =>
        {
            (terms, left_depth - 1)
        }
        other => (vec![other], left_depth),
    };
    terms.push(right);
    let depth = left_depth.max(right_depth) + 1;
    if depth > MAX_DEPTH {
        return Err(ParseExprError::TooDeep { at });
    }
    let expr = match operator {
        '|' => Expr::Union(terms),
        '&' => Expr::Intersection(terms),
        '-' => Expr::Difference(terms),
        _ => Expr::SymmetricDifference(terms),
    };
    Ok((expr, depth))
}
