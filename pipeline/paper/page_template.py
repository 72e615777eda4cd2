"""The page of the paper's report, as a template: `pipeline.paper.report` fills it in."""

from string import Template

PAGE = Template("""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>The paper, rerun</title>
<style>
body { font: 16px/1.5 system-ui, sans-serif; color: #1a1a1a; background: #fff; max-width: 62rem; margin: 2rem auto;
  padding: 0 1rem; }
h1 { font-size: 1.7rem; line-height: 1.2; }
h2 { font-size: 1.25rem; margin-top: 2.5rem; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: 0.85rem; font-variant-numeric: tabular-nums; }
th, td { text-align: left; vertical-align: top; padding: 0.3rem 0.9rem 0.3rem 0; border-bottom: 1px solid #ddd; }
th { border-bottom: 1px solid #888; }
td.number { white-space: nowrap; }
code { font-size: 0.8rem; }
td code { display: block; }
figure { margin: 1.5rem 0; }
img { width: 100%; height: auto; }
figcaption { color: #444; font-size: 0.9rem; }
.fails { font-weight: bold; color: #a00020; }
</style>
</head>
<body>
<h1>Efficient exploration and learning of whole body kinematics, rerun</h1>
<p>Rolf, Steil and Gienger let ASIMO explore two bimanual motions under an analytic controller, the teacher. From
one of them a recurrent network learned, online, to answer targets of both hands with the joints of the whole upper
body. Here all of it was done again, from seed $seed, on a simulated robot of ASIMO's proportions; ASIMO's own model
is not public. The free-hand drawings are generated: no person drew them.</p>

<h2>What it is to show</h2>
$checks

<h2>Figure 4: networks that learned pattern 1</h2>
$figures4
$turn4
<p>The pictures show the plane of the patterns; errors count distances ahead of it and behind it too. All that the
networks learned from lies on circles in that plane. Inside and far outside them the kinematics curves, and a nearly
linear answer leaves the plane: that is most of the error of a hand that is held still in the middle.</p>
$beyond
<p>Networks that learned pattern 1, on average (cm):</p>
<div class="wide">$depths</div>

<h2>Figure 5: networks that learned pattern 2</h2>
$figures5
$turn5

<h2>Why networks that learned pattern 2 fail on pattern 1</h2>
<p>In pattern 2 both hands always have the same sideways coordinate: they move left and right together, and are
never both inside or both outside. What the body is to do when they part sideways is not in the data, and networks
that learned from it do not answer to that direction: of the $asked_cm cm (root mean square) by which pattern 1
parts the hands and brings them together, they follow a part of $followed, where 1 would be all and 0 nothing. They
miss by $missed_cm cm in it; hands that never part would miss by $asked_cm cm. Pattern 1 combines all positions of
both hands evenly.</p>
<p>This is not peculiar to networks. Linear least squares, fitted to pattern 2 and least in norm, leaves out the
direction that it was not shown, and fails on pattern 1 alike: by $linear_cm cm on average, beside the networks'
$networks_cm cm. Taken apart by direction (root mean square), motions and errors show it:</p>
<div class="wide">$directions</div>

<h2>Figure 6: on the robot</h2>
<p>The network of seed $seed that learned pattern 1 commands the simulated robot over Zenoh at 10 Hz, through
pattern 2, which it has never seen. These are the robot's physical hands, dynamics included: $learned_cm cm from
their targets with the learned controller, $teacher_cm cm with the teacher, who does the same motion at the same
pace.</p>
$figures6

<h2>The learned controller beside the teacher</h2>
<p>On pattern 1, by kinematics alone: what counts is the posture that each gives for a target, not what a robot
makes of it. The learned controller answers a target with positions of the joints. The teacher works with velocities
and goes on from its own last posture. That it takes many short steps for each target, as it does while it explores,
is a choice: with one long step for each it answers at once too. Times are those of a call from Python where this
page was made; they vary. In the source, <code>tests/benchmarks/bench_ik.py</code> sets both beside the inverse
kinematics of Pink and of Drake.</p>
<div class="wide">$costs</div>

<h2>Where the paper's error comes from</h2>
$parts_text
<p>The same on all motions (cm; mean ± standard deviation over the networks where there is more than one):</p>
<div class="wide">$parts</div>

<h2>A rule to deploy: an inverse estimate and a learned forward model</h2>
<p>The rule <code>forward-inverse</code> learns in one pass from an exploration of the whole volume, seeds
$compared_seeds; errors are means ± standard deviations over them. The interval is Student's, and needs two seeds
(<code>reenact paper --seeds 5</code>). Nothing that it is tried on was learned. 120 s of robot time with a teacher took
$explore_seconds s to explore and to learn, with nothing beside it; a learning step takes $learning_us µs and a command
$command_us µs, where a step of the paper's rule takes $papers_us µs. Times vary with the machine.</p>
<div class="wide">$explored</div>
<p>Commands, with each seed for SEED and each motion for MOTION:</p>
<ul>$explored_commands</ul>

<h2>Rules and baselines side by side</h2>
<p>All of them learned from the same explorations, 120 s at 5 Hz with a teacher, from hands and joints as reached (cm,
mean ± standard deviation over the seeds; drawings: mean over all of them). Learning is the time for each tick of the
exploration, over all epochs; a command is called from Python, a target at a time.</p>
<div class="wide">$rules</div>

<h2>Without a teacher: beside goal babbling</h2>
<p>Goal babbling (Rolf, Steil and Gienger, 2010) learns an inverse model by trying to reach goals with it: paths from
goal to goal, exploratory noise that drifts slowly, a local linear map that learns at every tick, weighted by how
straight and with how little turning of joints the hands came along. Its robot is kinematics alone and is where it is
told to be at once, with no limit of speed, where <code>forward-inverse</code> led the simulated robot. Both have the
same time of the robot, ticks at 25 Hz and the seeds above; its settings are those of some dozen that did best on these
motions (cm, mean ± standard deviation; drawings: mean over all of them).</p>
<div class="wide">$alone</div>

<h2>Two teachers</h2>
<p>The teacher of the explorations above, resolved rates (<em>rates</em>), and the second one, Drake's differential
inverse kinematics as a quadratic program (<code>explore --teacher qp</code>), lead the simulated robot through the
same motions, from seed $seed. Error: of the hands at the end of each target's hold, the lag of teacher and servos
included. Margin: the smallest distance of a joint from a limit, in parts of its range. Joint speed: the largest, in
parts of the joint's limit. Comfort cost: half the squared distance from the comfort posture, in parts of the joints'
ranges and weighted, on average. Distance: the smallest between hands or forearms and other parts of the robot. Times
vary with the machine.</p>
<div class="wide">$teachers</div>

<h2>Every number</h2>
<p>Errors are distances of the hands from their targets in cm, averaged over time and hands (eq. 10); for networks,
mean ± standard deviation over them. <em>Teacher</em>: the same for the postures recorded while it explored.
<em>Linear</em>: least squares from targets to joints, fitted to the very samples that the networks learned from.
Where the paper has no number its finding is given.</p>
<p>Commands run in the folder of this page, with each of the seeds for SEED; what each seed gives is printed under
the name in the column <em>printed as</em>, with all its digits after <code>--json</code>. The teacher's and the
linear numbers are printed by <code>evaluate</code> too, under the same name with <code>teacher_</code> or
<code>linear_</code> before it (<code>mean_cm</code> under <code>teacher_cm</code> and <code>linear_cm</code>).
Nothing of this run is overwritten: what is learned or explored again goes to files of its own, and <code>reenact
diff</code> shows that it is the same. Every log here was made as <code>reenact explore --motion NAME --seed $seed
--out again-NAME.mcap</code> makes it. Times vary with the machine and are printed by none.</p>
<div class="wide">$table</div>
<p>Linear least squares does well because the kinematics is nearly linear over so small a region; it takes all
samples at once, while the network learns sample by sample as they come. Both can do better than the teacher whom
they learned from: its postures lag behind their targets in the direction of the motion, and over many directions
that evens out.</p>
</body>
</html>
""")
