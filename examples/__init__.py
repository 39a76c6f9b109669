"""Examples of use: tables, bench descriptions, scripts, a plant on one computer."""
