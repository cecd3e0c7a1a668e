//! ravec-twocolor
