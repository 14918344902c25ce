"""The report page of a run: its records, figures and texts.

- `record.py` is what a caller fills; `signals.py` makes its curves of topics and plants.
- `page.py` writes the page; `timeline.py` and `path_figure.py` draw its figures, with the axes and
  marks of `figure_parts.py`; `where_sc_leads.py` has the boxes to which SC would lead.
- `counterexample_page.py` makes the same page of a run that violates a property.
"""
