"""Building blocks of the panel's pages: plain HTML elements with texts, controls, charts."""
