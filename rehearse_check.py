import sys, time, os
from pathlib import Path
import numpy as np
from fgplan.io.mission_file import load_mission
from fgplan.planners.program import participants, run_programs
from fgplan.planners.registry import find_planner
from fgplan.team.in_process import InProcessTransport
cache=Path(os.environ["NUMBA_CACHE_DIR"])
m=load_mission(sys.argv[1]); p=find_planner(sys.argv[2])
def files(): return {f.name for f in cache.rglob("*.nbc")}
t=time.time(); p.rehearse(m,np.random.default_rng(m.seed)); print("rehearse",time.time()-t)
a=files()
g=lambda: np.random.default_rng(m.seed)
names=participants(p,m)
t=time.time()
ps={n:p.program(m,n,g()) for n in names}
print("made", time.time()-t)
b=files()
e=run_programs(ps,InProcessTransport(names))
print("ran", time.time()-t)
c=files()
p.team_plan(m,{n:o.report(o.state) for n,o in e.items()},g())
print(len(a), b-a, c-b, files()-c)
