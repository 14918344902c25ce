"""Campaigns: many seeded runs of a system, and the statistics of them.

In reading order (`api/campaigning.py` calls them):

- `compiled_unit.py` makes the C of a system that is flown: its program and its measures;
  `recipe.py` packs it with what else a machine needs that has not the system.
- `batch_flights.py` flies it in batches, by the C in `c/`: `soter_batch.c` makes many runs in one
  call, `soter_apart.c` has such a call made in a process of its own.
- `fly_campaign.py` takes a campaign to all its flights, by threads or on a Ray cluster.
- `arms.py` makes the systems to compare with: the same seeds, flown by other rules;
  `release_lateness.py` measures how late this machine releases a process, for one of them.
- `store.py` keeps the folder of a campaign: what is flown, and a line for each flight.
- `statistics.py` computes intervals for counts; `result.py` makes the figures of the flights.
- `tables.py` puts the figures into words and tables; `page.py` makes the HTML page of them.
"""
