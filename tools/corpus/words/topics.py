"""Topics of the sentences: words and phrases by their symbol in the grammar's rules.

Phrases fit every rule of ``grammar.py``: people and things are singular, places can be driven to,
qualities can be more or less, and no phrase contains a pronoun.
"""

Topic = dict[str, tuple[str, ...]]


def _topic(speaker: str, places: str, things: str, many: str, qualities: str, acts: str) -> Topic:
    """Return the expansions by symbol, from lists separated by commas.

    Args:
        who: people.
        places: with their preposition, "at the market".
        things: with their article.
        many: plurals without one.
        qualities: adjectives that fit each of the things.
        acts: "bake/baked/baking the bread": infinitive, past and gerund of the first word.
    """
    forms = [act.split(" ", 1) for act in acts.split(", ")]
    verbs = [(*verb.split("/"), rest) for verb, rest in forms]
    at = tuple(places.split(", "))
    return {
        "WHO": tuple(speaker.split(", ")),
        "AT": at,
        "PLACE": tuple(place.split(" ", 1)[1] for place in at),
        "THING": tuple(things.split(", ")),
        "MANY": tuple(many.split(", ")),
        "ADJ": tuple(qualities.split(", ")),
        "DO": tuple(f"{do} {rest}" for do, _, _, rest in verbs),
        "DID": tuple(f"{did} {rest}" for _, did, _, rest in verbs),
        "DOING": tuple(f"{doing} {rest}" for _, _, doing, rest in verbs),
    }


TOPICS: dict[str, Topic] = {
    "cooking": _topic(
        "my grandmother, the chef, our neighbour, my cousin, the baker, my best friend",
        "at the market, at the restaurant, in the old bakery, at the cooking school",
        "the soup, this recipe, the sauce, the chocolate cake, the kitchen, that fresh bread",
        "onions, lemons, guests, tomatoes, recipes, dirty plates",
        "good, simple, special, strange, expensive, wonderful",
        "bake/baked/baking fresh bread, cut/cut/cutting all of the onions, taste/tasted/tasting"
        " the sauce, invite/invited/inviting the whole street, wash/washed/washing the dishes,"
        " turn/turned/turning the pancakes, follow/followed/following the recipe,"
        " share/shared/sharing the last piece of cake",
    ),
    "travel": _topic(
        "my brother, the tour guide, a friend of mine, the taxi driver, my aunt, the captain",
        "at the airport, in the mountains, on the island, at the border, in the old harbour",
        "the hotel, the journey, that little village, the view, the night train, the beach",
        "suitcases, tourists, islands, tickets, photographs, bridges",
        "beautiful, strange, quiet, expensive, special, romantic",
        "pack/packed/packing the heavy bags, catch/caught/catching the last train,"
        " climb/climbed/climbing the highest mountain, book/booked/booking a cheap room,"
        " cross/crossed/crossing the whole country, sleep/slept/sleeping under the stars,"
        " show/showed/showing the passport, discover/discovered/discovering a hidden beach",
    ),
    "work": _topic(
        "my boss, the new colleague, the manager, our engineer, the customer, the director",
        "at the office, in the factory, at the conference, at the head office",
        "the project, this long meeting, the plan, the contract, the new computer, the report",
        "meetings, emails, results, mistakes, deadlines, ideas",
        "important, boring, complicated, practical, surprising, confusing",
        "finish/finished/finishing the report, change/changed/changing the plan,"
        " explain/explained/explaining the results, solve/solved/solving the biggest problem,"
        " call/called/calling the customer, write/wrote/writing a hundred emails,"
        " improve/improved/improving the little details, start/started/starting from the beginning",
    ),
    "school": _topic(
        "my teacher, the professor, my little sister, the new student, the librarian, our tutor",
        "at the library, at the university, in the classroom, at the science museum",
        "the exam, this book, the lesson, the question, the experiment, the last chapter",
        "questions, students, exercises, languages, numbers, good answers",
        "difficult, interesting, clear, useful, long, unusual",
        "learn/learned/learning a new language, repeat/repeated/repeating the rules,"
        " read/read/reading the whole book, understand/understood/understanding the question,"
        " find/found/finding the answer, draw/drew/drawing a circle on the board,"
        " compare/compared/comparing the two answers, pass/passed/passing the difficult exam",
    ),
    "music": _topic(
        "the singer, the drummer, my uncle, the conductor, the piano teacher, a street musician",
        "at the concert hall, at the festival, in the studio, at the opera",
        "the song, this old piano, the rhythm, the concert, the melody, that record",
        "guitars, songs, musicians, drums, concerts, wrong notes",
        "loud, gentle, brilliant, sad, powerful, beautiful",
        "play/played/playing the first song again, sing/sang/singing a long high note,"
        " dance/danced/dancing around the room, record/recorded/recording a new album,"
        " listen/listened/listening to the rhythm, carry/carried/carrying the big drum,"
        " practise/practised/practising the same four notes, tune/tuned/tuning the old guitar",
    ),
    "sport": _topic(
        "the goalkeeper, our coach, my sister, the referee, the champion, my running partner",
        "at the stadium, at the swimming pool, in the park, at the gym",
        "the match, the race, this team, the training, the tournament, the final",
        "runners, players, medals, bicycles, goals, spectators",
        "hard, exciting, fast, fair, tough, slow",
        "win/won/winning the final, run/ran/running ten miles, throw/threw/throwing the ball,"
        " lift/lifted/lifting the heavy weights, jump/jumped/jumping over the fence,"
        " train/trained/training for the big race, swim/swam/swimming across the lake,"
        " watch/watched/watching the third match",
    ),
    "city": _topic(
        "the mayor, the bus driver, my neighbour, an old lady, the architect, the police officer",
        "at the station, in the city centre, on the main square, at the new shopping centre",
        "the traffic, the new building, our street, the old bridge, the city, the underground",
        "buses, towers, cars, bicycles, street lights, people",
        "noisy, ugly, busy, impressive, strange, different",
        "cross/crossed/crossing the busy street, park/parked/parking the car, catch/caught/catching"
        " the bus, build/built/building another tower, paint/painted/painting the old houses,"
        " stop/stopped/stopping the traffic, clean/cleaned/cleaning the whole square,"
        " take/took/taking the next exit",
    ),
    "family": _topic(
        "my mother, my father, the baby, my grandfather, my little brother, my favourite aunt",
        "at the church, at the summer house, on the farm, in the village",
        "the wedding, the birthday party, the family photograph, our old house, the long table",
        "cousins, presents, children, stories, balloons, candles",
        "important, crazy, special, peaceful, lively, beautiful",
        "tell/told/telling the same old story, open/opened/opening the presents,"
        " laugh/laughed/laughing about the past, hug/hugged/hugging the whole family,"
        " plan/planned/planning the big party, call/called/calling the grandparents,"
        " talk/talked/talking about the future, dance/danced/dancing until midnight",
    ),
    "nature": _topic(
        "the gardener, the farmer, my grandfather, the forester, a young biologist, my neighbour",
        "in the forest, at the river, in the national park, at the lake, by the sea",
        "the garden, the weather, that old tree, the river, the storm, the rain",
        "flowers, birds, apple trees, clouds, mushrooms, wild animals",
        "wild, beautiful, quiet, dangerous, cold, impressive",
        "plant/planted/planting a round tree, water/watered/watering the flowers,"
        " watch/watched/watching the birds, walk/walked/walking through the rain,"
        " protect/protected/protecting the forest, collect/collected/collecting mushrooms,"
        " wait/waited/waiting for the sunset, feed/fed/feeding the ducks",
    ),
    "health": _topic(
        "the doctor, the dentist, the nurse, my grandmother, my yoga teacher, the pharmacist",
        "at the hospital, at the pharmacy, at the health centre, in the waiting room",
        "the treatment, my shoulder, the diet, the medicine, this exercise, the appointment",
        "vegetables, exercises, tablets, patients, bandages, cups of tea",
        "unpleasant, helpful, complicated, strange, normal, serious",
        "sleep/slept/sleeping for nine hours, drink/drank/drinking more water,"
        " stretch/stretched/stretching both arms, eat/ate/eating less sugar, take/took/taking a"
        " deep breath, see/saw/seeing the dentist, bend/bent/bending the left knee,"
        " stay/stayed/staying in bed",
    ),
    "technology": _topic(
        "the programmer, my nephew, the salesman, the technician, the robot, a young scientist",
        "at the laboratory, at the computer shop, in the workshop, at the research centre",
        "the phone, the internet, this program, the new camera, the robot, the screen",
        "cables, passwords, batteries, robots, updates, buttons",
        "clever, slow, useful, clumsy, complicated, expensive",
        "press/pressed/pressing the red button, repair/repaired/repairing the phone,"
        " change/changed/changing the password, connect/connected/connecting all of the cables,"
        " build/built/building a small robot, measure/measured/measuring the temperature,"
        " switch/switched/switching it off and on again, delete/deleted/deleting the old files",
    ),
    "home": _topic(
        "the plumber, my flatmate, the landlord, the carpenter, my father, the electrician",
        "at the furniture shop, at the flea market, in the new flat, at the recycling centre",
        "the sofa, the roof, the round table, this huge box, the wall, the bathroom",
        "boxes, chairs, windows, shelves, tools, old curtains",
        "old, ugly, dirty, bright, solid, huge",
        "carry/carried/carrying the huge box, paint/painted/painting the wall,"
        " open/opened/opening the window, fix/fixed/fixing the door, move/moved/moving the sofa,"
        " clean/cleaned/cleaning the whole house, hang/hung/hanging up the mirror,"
        " build/built/building a long shelf",
    ),
    "money": _topic(
        "the banker, the shop assistant, my uncle, the cashier, the lawyer, my rich cousin",
        "at the bank, at the supermarket, in the shoe shop, at the car dealer",
        "the bill, the price, this sale, the tax form, the old coat, the insurance",
        "coins, receipts, discounts, shoes, customers, numbers",
        "fair, cheap, ridiculous, strange, old, reasonable",
        "save/saved/saving a little money, pay/paid/paying the bill, buy/bought/buying new shoes,"
        " compare/compared/comparing the prices, count/counted/counting the coins,"
        " ask/asked/asking for a discount, sell/sold/selling the old car,"
        " sign/signed/signing the contract",
    ),
    "books": _topic(
        "the writer, the actor, the director, a journalist, the critic, my book club",
        "at the cinema, at the bookshop, at the theatre, at the film festival",
        "the film, the ending, this novel, the first scene, the story, the main character",
        "pages, actors, jokes, secrets, characters, famous scenes",
        "exciting, slow, funny, dark, predictable, moving",
        "write/wrote/writing a short story, read/read/reading the last page first,"
        " watch/watched/watching the same film twice, imagine/imagined/imagining another ending,"
        " quote/quoted/quoting the famous line, cry/cried/crying at the end,"
        " guess/guessed/guessing the secret, fall/fell/falling asleep in the middle",
    ),
    "animals": _topic(
        "the vet, the zookeeper, my niece, the farmer, the dog trainer, our neighbour",
        "at the zoo, on the farm, at the animal shelter, in the riding school",
        "the dog, that lazy cat, the horse, the parrot, the elephant, the fish",
        "puppies, horses, rabbits, elephants, chickens, butterflies",
        "clever, wild, huge, gentle, nervous, friendly",
        "feed/fed/feeding the horses, walk/walked/walking the dog, wash/washed/washing the"
        " elephant, ride/rode/riding across the field, chase/chased/chasing the chickens,"
        " train/trained/training a puppy, find/found/finding the lost cat,"
        " teach/taught/teaching the parrot a new word",
    ),
    "cars": _topic(
        "the mechanic, my driving teacher, the lorry driver, my mother, my friend, the inspector",
        "at the garage, at the petrol station, on the motorway, at the crossing",
        "the car, the engine, this road, the steering wheel, the old van, the tunnel",
        "lorries, traffic lights, tyres, road signs, curves, motorbikes",
        "dangerous, old, bad, loud, strange, dirty",
        "turn/turned/turning the wheel, drive/drove/driving all night, stop/stopped/stopping at"
        " every corner, change/changed/changing the tyre, overtake/overtook/overtaking the lorry,"
        " push/pushed/pushing the car, park/parked/parking between two lorries,"
        " slow/slowed/slowing down",
    ),
}
