"""What the panel's pages are made of: plain HTML elements with words, controls, charts."""
