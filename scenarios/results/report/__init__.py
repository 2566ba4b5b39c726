"""The report of a run as one HTML file that needs no network.

page    the whole page and its file
tables  tables of figures, events, links and definitions
plots   pictures as inline SVG
curves  their curves over time and along the path
axes    scales and ticks of the plots
markup  HTML and SVG elements

`page.css` and `page.js` are its style and its linked cursor.
"""
