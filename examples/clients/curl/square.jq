# Poses as the REST plugin streams them in, what to do next out: closes a square of $side on odometry.

def wrap: . - 6.283185307179586 * ((. / 6.283185307179586) + 0.5 | floor);
def clamp($least; $most): [[., $least] | max, $most] | min;
def hypot($x; $y): $x * $x + $y * $y | sqrt;
def sign: if . < 0 then -1 else 1 end;

# The message in a line `data: {"key": …, "value": base64, …}`; nothing where it cannot be read.
def message: try (ltrimstr("data:") | fromjson | select(.value) |
  (if .value | type == "string" then .value | @base64d | fromjson else .value end) + {key: .key}) catch empty;

# Add the step since the pose before, unless the daemon was restarted or the pose was set.
def advance($new):
  .old as $old | .old = $new |
  if $old == null or $new.seq <= $old.seq then .
  else
    ($new.x - $old.x) as $dx | ($new.y - $old.y) as $dy | ($new.theta - $old.theta) as $turned |
    if hypot($dx; $dy) > 0.5 or ($turned | fabs) > 0.5 then .
    else
      (.theta - $old.theta) as $frame |
      .x += ($frame | cos) * $dx - ($frame | sin) * $dy |
      .y += ($frame | sin) * $dx + ($frame | cos) * $dy |
      .theta += $turned
    end
  end;

# Sets `line`: turn to the next corner, drive there, and turn as in the beginning after the last one.
def turn($error): .line = "go 0 \($error | sign * ([fabs * 2 + 0.15, 1.2] | min))";
def decide:
  if .corners == [] then
    (0 - .theta | wrap) as $error |
    if $error | fabs > 0.02 then turn($error) else .line = "done \({x, y, theta} | tojson)" end
  else
    (.corners[0][0] - .x) as $dx | (.corners[0][1] - .y) as $dy |
    hypot($dx; $dy) as $distance | (atan2($dy; $dx) - .theta | wrap) as $error |
    if .aimed and ($distance < 0.01 or ($error | fabs > 1)) then .aimed = false | .corners |= .[1:] | decide
    elif .aimed or ($error | fabs < 0.02) then
      .aimed = true | .line = "go \([0.03 + 1.5 * $distance, 0.25] | min) \(2 * $error | clamp(-1; 1))"
    else turn($error)
    end
  end;

foreach (inputs | select(startswith("data:")) | message) as $message (
  {x: 0, y: 0, theta: 0, aimed: false, corners: [[$side, 0], [$side, $side], [0, $side], [0, 0]]};
  .line = null |
  if $message.key | endswith("yahboomd/pose") then
    if [$message | .x, .y, .theta, .seq | type] == ["number", "number", "number", "number"]
    then advance($message) | decide else . end
  elif ($message.key | endswith("yahboomd/status")) and ($message.state | IN("waiting", "standing", "driving", "stopping") | not)
  then .line = "why It is \($message.state): \($message.why)"
  else . end;
  .line // empty)
