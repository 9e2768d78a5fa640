"""Table I of Khodayi-mehr, Kantaros and Zavlanos 2019."""
