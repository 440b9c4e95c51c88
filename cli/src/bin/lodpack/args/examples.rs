//! What `--help` and the man pages show below the options.

pub const LODPACK: &str = "\
Examples:
  lodpack build mesh.obj            writes mesh.lodpack
  lodpack info mesh.lodpack
  lodpack view mesh.lodpack
  lodpack extract mesh.lodpack --triangles 50000 -o small.glb

Exit status: 0 success; 1 verify or selftest found a problem, or status a part that is not done; 2 the command could not run; \
130 stopped by Ctrl-C or SIGTERM. `lodpack view` ends with the viewer's own status.";

pub const BUILD: &str = "\
Examples:
  lodpack build scan.ply                                          writes scan.lodpack beside it
  lodpack build part.stl --unit mm --tolerance 0.05mm
  lodpack build city/                                             all meshes in a folder, or 'city/**/*.obj'
  lodpack build scan.lodpack --tolerance 1cm -o coarse.lodpack    builds a file again
  lodpack build a.glb b.glb --effort best --json -o both.lodpack
  lodpack build huge.ply --workers 4                              four processes share the work
  lodpack build huge.ply --memory 2GiB --resume                   continues a build that was stopped
  lodpack build scan.ply --channels colour,quality                keeps these beside the shape; none keeps the shape alone
  lodpack build atlas/                                            writes atlas.lodpack beside it
  lodpack build dem.tif --tolerance 1m                            terrain: a file of heights; --as mesh makes triangles
  lodpack build tiles/*.tif --surface wgs84 -o earth.lodpack      tiles as one mosaic, on the globe
  lodpack build dem.tif --drape photo.tif                         with an image over it; --ramp earth colours it by height
  lodpack build heights.png --spacing 10 --vertical-unit m --unit m
  lodpack build --job scan.job --part 3

Without -o the file is named after the input, or after the first of several, and lies beside it. An existing file is never \
overwritten without --force.";

pub const VIEW: &str = "\
Examples:
  lodpack view scan.lodpack
  lodpack view https://example.org/scan.lodpack --tolerance 2
  lodpack view scan.lodpack --screenshot scan.png --size 1600x1200
  lodpack view scan.lodpack --help                                lists the viewer's options

The viewer is looked for beside lodpack itself, then in the directories of PATH.";

pub const SERVE: &str = "\
Examples:
  lodpack serve scan.lodpack --open                   shows it in a browser
  lodpack serve *.lodpack --bind 0.0.0.0 --port 80    for other machines, too
  lodpack serve scan.lodpack --cors                   for pages of other hosts
  lodpack serve --check https://example.org/scan.lodpack

It prints an address for each file, which shows it in the viewer page, and serves these files and the page alone. \
With --cors, pages on any host may read the files. Ctrl-C stops it.

Exit status: 0 the server was stopped, or --check found nothing; 1 --check found a problem; 2 the command could not run.";

pub const PLAN: &str = "\
Examples:
  lodpack plan scan.ply --parts 16             makes the job scan.job beside it
  lodpack build --job scan.job --part 3        each of 0 to 15, anywhere, in any order
  lodpack merge scan.job                       writes scan.lodpack
  lodpack plan scan.ply --parts 64 --stages    only begins the job: `lodpack work` plans and builds on many machines

Without -o the job is named after the input, or after the first of several, and lies beside it. A job called NAME.job is merged \
to NAME.lodpack, any other to a file named after its first input.";

pub const WORK: &str = "\
Examples:
  lodpack plan scan.ply --parts 16 --stages              begins the job scan.job
  lodpack work scan.job                                  the same on any machine, as often as you like: it ends when all is done
  lodpack work scan.job --stage repair --task 3          one task, for schedulers; those of earlier stages have to be done
  lodpack merge scan.job                                 writes scan.lodpack

Stages in order: import, scan, count, cut, divide, repair, match, segment, seams, build. Tasks of one stage can be done at the same time. \
A task that another worker has taken is waited for; if that worker dies, the task is done here. The bytes do not depend on who does what.";

pub const ADD: &str = "\
Examples:
  lodpack plan tiles/*.ply --extensible --tolerance 0.05 -o job-1/
  lodpack build --job job-1/ --part 0-7 && lodpack merge job-1/ -o land.lodpack
  lodpack add job-1/ new.ply -o job-2/
  lodpack build --job job-2/ --part 0-8 && lodpack merge job-2/ -o land.lodpack --force

The result is the file that a plan of all inputs at once gives. A .lodpack file holds only what it shows, so adding takes the \
job. Once the new job is planned, the earlier one can be removed.";

pub const MERGE: &str = "\
Examples:
  lodpack merge scan.job                                    writes scan.lodpack beside it
  lodpack merge job/ -o scan.lodpack
  lodpack merge parts/                                      writes parts.lodpack, where parts/ is not within a job
  lodpack merge part-0.lodpart part-1.lodpart -o scan.lodpack

Without -o the file lies beside the job and has the name that `lodpack plan` has shown. Parts in a directory outside of any job \
give the file the directory's name. An existing file is never overwritten without --force.";

pub const STATUS: &str = "\
Examples:
  lodpack status scan.job
  lodpack status scan.job --json | jq '.parts[] | select(.state != \"done\") | .part'

  lodpack status scan.job --json | jq -r '.stages[].failed[].note' | xargs cat

Exit status: 0 all parts are done; 1 some are not; 2 the command could not run.";

pub const SUBMIT: &str = "\
Examples:
  lodpack submit scan.job
  lodpack submit scan.job -o /shared/scan.lodpack
  lodpack submit scan.job --dry-run

Recipes for Dask, Snakemake, GNU parallel and Kubernetes are in cli/engines of the source code.";

pub const INFO: &str = "\
Examples:
  lodpack info scan.lodpack
  lodpack info scan.lodpack --why
  lodpack info https://example.org/scan.lodpack --json | jq .levels
  lodpack info scan.lodpack --why --json | jq '.left_out[] | {what, bytes: .saved.bytes}'";

pub const VERIFY: &str = "\
Examples:
  lodpack verify scan.lodpack
  lodpack verify scan.lodpack --against scan.ply

Exit status: 0 the file is sound; 1 a problem was found; 2 the command could not run.";

pub const COMPARE: &str = "\
Examples:
  lodpack compare scan.ply simplified.glb              both directions, root mean squares, and where the largest distance is
  lodpack compare scan.ply scan.lodpack --level all    every level, beside the error that the file states
  lodpack compare scan.lodpack tiles/tileset.json      every level of a tileset, beside its geometricError
  lodpack compare dem.tif terrain/layer.json           quantized-mesh, within the edges of the raster
  lodpack compare a.obj b.obj --gap 0.1% --json

The largest distance lies between two numbers, at most --gap apart: one that occurs, and one that none exceeds. Each direction has its own, and \
the larger one is the distance of the surfaces. A raster is a surface between its samples, along the shorter diagonal of each cell; how far its samples are \
off, which is what files of heights state, is printed beside it. A mesh or a .lodpack file is taken to the axes, the unit and the place of glTF or of a \
tileset as `lodpack extract` and `lodpack export` do it; two meshes are compared as they are. Nothing but the files beside a tileset is read.";

pub const EXTRACT: &str = "\
Examples:
  lodpack extract scan.lodpack -o finest.ply
  lodpack extract scan.lodpack --triangles 50000 -o small.glb
  lodpack extract scan.lodpack --triangles 50000 --texels all -o sharp.glb    its images are as fine as those of the file
  lodpack extract scan.lodpack --triangles 5000 --texels 1048576 --images png -o web.glb     at most 1,024 x 1,024 texels, exact
  lodpack extract scan.lodpack --bbox 0,0,0,1,1,1 --tolerance 0.002 -o corner.obj
  lodpack extract scan.lodpack --tolerance 0.4edge -o near.ply           0.4 mean edges of the input
  lodpack extract scan.lodpack --bbox 0,0,0,1,1,1 --context -o focus.ply
  lodpack extract scan.lodpack --normals smooth -o lit.obj                GLB has normals anyway; --normals none leaves them out
  lodpack extract scan.lodpack --format ply -o - | other-program
  lodpack extract dem.lodpack --bbox 500000,5180000,0,510000,5190000,0 -o window.tif

A root is a piece of the surface; each is drawn at one level. A length with a unit (2mm) works \
where `lodpack info` says what a unit is. --json prints certified_error (of everything written), rounding (what \
single precision of the format adds), certified_error_in_box and limited_by (tolerance, finest, triangles or nodes: what \
keeps the mesh from being finer). GLB has metres and y up where the file says its unit and which axis points up.";

pub const EXPORT: &str = "\
Examples:
  lodpack export scan.lodpack --as 3dtiles -o tiles/
  lodpack export scan.lodpack --as 3dtiles -o tiles/ --tolerance 0.002 --up z
  lodpack export scan.lodpack --as 3dtiles -o scan.3tz                   all tiles in one file
  lodpack export dem.lodpack --as 3dtiles -o terrain/                    a file of heights
  lodpack export scan.lodpack --as glb-lod -o scan.glb                   all levels in one GLB, for engines

A tile is a root at a level; its geometric error is the certified error. Borders are drawn so that tiles of any levels meet without \
cracks. The tiles are glTF with EXT_meshopt_compression, which Cesium, three.js (3d-tiles-renderer) and others \
read. In one GLB, a level is shown where its error is below a pixel at 1,920 x 1,080 (MSFT_lod); programs that do not know the \
extension show the finest.";

pub const ATLAS: &str = "\
Examples:
  lodpack atlas scan.ply -o atlas/
  lodpack atlas model.glb -o atlas/ --mips        images of colours and all else beside those of positions, at all resolutions
  lodpack build atlas/ -o scan.lodpack
  lodpack build atlas/mip_02 -o coarse.lodpack    from images of a quarter of the steps";

pub const SELFTEST: &str = "\
Examples:
  lodpack selftest --quick
  lodpack selftest --case finger --case fan
  lodpack selftest --csv stability.csv

Exit status: 0 all rows are good; 1 some are not; 2 the command could not run.";

pub const REPORT: &str = "\
Examples:
  lodpack report scan.ply -o report/
  lodpack report scan.lodpack --against scan.ply -o report/
  lodpack report scan.ply --peers peers.csv --json -o report/ | jq .default_check";

pub const COMPLETIONS: &str = "\
Examples:
  lodpack completions bash > ~/.local/share/bash-completion/completions/lodpack
  lodpack completions zsh > ~/.zfunc/_lodpack            where ~/.zfunc is in zsh's fpath
  lodpack completions fish > ~/.config/fish/completions/lodpack.fish

A shell that is started afterwards completes.";

pub const MAN: &str = "\
Examples:
  lodpack man | man -l -
  lodpack man build | man -l -
  lodpack man -o ~/.local/share/man/man1 --force";
