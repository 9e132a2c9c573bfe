# A mass on a spring and a damper, as a simulator for plid. It needs only Julia's Base:
#
#     plid gap check-simulator -- julia --startup-file=no oscillator.jl
#
# Standard output belongs to the protocol (docs/simulator-protocol.md), so print to stderr.

const RATE, STEPS, MASS = 100.0, 10, 2.0
const INPUTS, PORTS = 1, 1
const DESCRIPTION = join([
    """{"protocol": 1, "name": "oscillator", "rate_hz": $RATE, "steps_per_sample": $STEPS, """,
    """"inputs": [{"name": "force", "unit": "N"}], """,
    """"outputs": [{"name": "position", "kind": "position", "unit": "m"}], """,
    """"ports": [{"name": "spring", "input": "force", "force_unit": "N", "displacement_unit": "m"}], """,
    """"parameters": [{"name": "stiffness", "value": 800.0, "unit": "N/m", "lower": 0.0}, """,
    """{"name": "damping", "value": 4.0, "unit": "N s/m", "lower": 0.0}]}""",
])

mutable struct Oscillator
    stiffness::Float64
    damping::Float64
    x::Float64
    v::Float64
end

# Goes to rest, and returns displacement and velocity of each port, one after the other.
function start!(plant, parameters)
    plant.stiffness, plant.damping = parameters
    plant.x = plant.v = 0.0
    return [plant.x, plant.v]
end

# Advances by one step, and returns the outputs at its start and the motions at its end.
function step!(plant, u, forces)
    y = [plant.x]
    h = 1 / (RATE * STEPS)
    plant.v += h * (u[1] + forces[1] - plant.damping * plant.v - plant.stiffness * plant.x) / MASS
    plant.x += h * plant.v
    return y, [plant.x, plant.v]
end

function run!(plant, parameters, u)
    start!(plant, parameters)
    rows = Float64[]
    for held in eachcol(u), step in 1:STEPS
        y, _ = step!(plant, held, zeros(PORTS))
        step == 1 && append!(rows, y)
    end
    return rows
end

numbers(count) = Float64[ltoh(read(stdin, Float64)) for _ in 1:count]

# One write for each answer: a head, then the numbers.
function answer(head, values=Float64[])
    bytes = IOBuffer()
    write(bytes, head)
    foreach(value -> write(bytes, htol(Float64(value))), values)
    write(stdout, take!(bytes))
    flush(stdout)
end

function parameters_of(request)
    inside = match(r"\"parameters\"\s*:\s*\[([^\]]*)\]", request).captures[1]
    return [parse(Float64, word) for word in split(inside, ','; keepempty=false)]
end

function serve(plant)
    answer(DESCRIPTION * "\n")
    while !eof(stdin)
        first = read(stdin, UInt8)
        if first == UInt8('s')
            values = numbers(INPUTS + PORTS)
            y, motions = step!(plant, values[1:INPUTS], values[INPUTS+1:end])
            answer("s", [y; motions])
            continue
        end
        request = Char(first) * readline(stdin)
        samples = match(r"\"samples\"\s*:\s*(\d+)", request)
        # All inputs are read before anything can fail, because the next bytes must be a request.
        u = samples === nothing ? nothing : parse(Int, samples.captures[1])
        u = u === nothing ? nothing : reshape(numbers(INPUTS * u), INPUTS, u)
        try
            parameters = parameters_of(request)
            values = u === nothing ? start!(plant, parameters) : run!(plant, parameters, u)
            answer("{\"ok\": true}\n", values)
        catch failure
            why = replace(sprint(showerror, failure), '\\' => '/', '"' => '\'', '\n' => ' ')
            answer("{\"error\": \"$why\"}\n")
        end
    end
end

serve(Oscillator(0, 0, 0, 0))
