"""Figures 5 to 9 of Khodayi-mehr, Kantaros and Zavlanos 2019."""
