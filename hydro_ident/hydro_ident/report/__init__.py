"""Reports: one self-contained HTML file that fetches nothing, with its plotting library in it.

Shared arguments: `channels`, `held_out`: rows of the channels that are shown, those that took no
part in a fit; `owner`: which joint a cylinder's or valve's name belongs to, for its colour;
`title`, `lead`: a section's heading and the line below it; `most`: lines shown at most.
"""
