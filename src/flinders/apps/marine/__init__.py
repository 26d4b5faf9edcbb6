"""Boats and aircraft that are swung: logs of their instruments, the deviation of a compass, rules and certificates.

For whoever adjusts a compass: a swing, as a table or a log under way, gives coefficients A to E and a deviation card.

- `swing`: the use case, from recordings or tables to a judged swing; ``cli`` has its command
- `deviation`, `legs`, `compensation`, `standards`: coefficients, straight legs, correctors, rules
- `compass_log`, with `nmea0183`, `nmea2000` and `signalk`: logs of a boat; `swing_table`: tables of headings
- `swing_words`, `swing_pages`, `certificate`: what a swing says, on the terminal and on paper
"""
