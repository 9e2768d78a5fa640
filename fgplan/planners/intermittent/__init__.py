"""Teams that meet by a schedule and plan to their next meeting (Khodayi-mehr et al. 2019)."""
